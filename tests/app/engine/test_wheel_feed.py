"""The observer's errand as the engine reads it from the wheel slot."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from app.engine.wheel_feed import WheelFeed
from app.runtime.latest import LatestReader, LatestWriter, create_slot
from observer.navigation.errand import Errand, Goal
from observer.robots.contract import SonarReading

ERRAND = Errand(
    Goal(3, 2.0, -0.5, 1e-3), 99.9, 0.1, 0.2, 0.3, 0.25, 0.0, 0.26, 0.38, 0.44,
    (SonarReading(0, 0.1, 0.0, 0.0, None, 99.8), SonarReading(1, 0.1, 0.0, 0.2, 1.5, 99.85)),
)  # fmt: skip


@pytest.fixture
def slot() -> Iterator[tuple[LatestWriter, WheelFeed]]:
    fd = create_slot(64 * 1024)
    writer, reader = LatestWriter(fd), LatestReader(fd)
    yield writer, WheelFeed(reader)
    writer.close()
    reader.close()
    os.close(fd)


def test_the_errand_is_read_back_unchanged(slot: tuple[LatestWriter, WheelFeed]) -> None:
    writer, feed = slot
    assert feed.errand(100.0) is None
    writer.write({"observer": [], "errand": ERRAND.facts()})
    assert feed.errand(100.0) == ERRAND
    assert feed.errand(100.9) == ERRAND
    assert feed.errand(101.0) is None, "the robot is gone"
    writer.write({"observer": []})
    assert feed.errand(100.0) is None


@pytest.mark.parametrize("errand", [7, {}, {**ERRAND.facts(), "goal": None}, "x"])
def test_an_invalid_errand_reads_as_none(
    slot: tuple[LatestWriter, WheelFeed], errand: object
) -> None:
    writer, feed = slot
    writer.write({"errand": ERRAND.facts()})
    assert feed.errand(100.0) == ERRAND
    writer.write({"errand": errand})
    assert feed.errand(100.0) is None
