"""The engine's data in shared memory: the newest only, and nothing implausible."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace

import pytest

from app.drive.engine_feed import EngineFeed
from app.runtime.latest import LatestReader, LatestWriter, create_slot
from observer.guard.sight import FreeScan, SeenObstacle, Sight, sight_of
from observer.types import Status

SIGHT = Sight(
    7, 99.9, 100.0, "real", Status.OK, (), True,
    (SeenObstacle(1, 2.0, 0.1, -0.3, 0.0, 0.2, 0.05, None, False),),
    FreeScan((-0.1, 0.1), (None, 2.0), (0.5, 0.5), (4.0, 1.9)),
)  # fmt: skip


@pytest.fixture
def slot() -> Iterator[tuple[LatestWriter, EngineFeed[Sight]]]:
    fd = create_slot(64 * 1024)
    writer, reader = LatestWriter(fd), LatestReader(fd)
    yield writer, EngineFeed(reader, sight_of)
    writer.close()
    reader.close()
    os.close(fd)


def test_the_newest_sight_is_kept_until_the_next(
    slot: tuple[LatestWriter, EngineFeed[Sight]],
) -> None:
    writer, feed = slot
    assert feed.newest(100.0) is None
    writer.write(SIGHT.facts())
    assert feed.newest(100.0) == SIGHT
    assert feed.newest(105.0) == SIGHT, "how old it may be is for others to say"
    writer.write(replace(SIGHT, frame=8).facts())
    writer.write(replace(SIGHT, frame=9).facts())
    newest = feed.newest(100.0)
    assert newest is not None
    assert newest.frame == 9


@pytest.mark.parametrize(
    "header", [{}, {**SIGHT.facts(), "status": "fine"}, {**SIGHT.facts(), "received": 101.0}]
)
def test_an_implausible_header_gives_no_sight(
    slot: tuple[LatestWriter, EngineFeed[Sight]], header: dict[str, object]
) -> None:
    writer, feed = slot
    writer.write(SIGHT.facts())
    feed.newest(100.0)
    writer.write(header)
    assert feed.newest(100.0) is None
    assert feed.newest(200.0) is None
    writer.write(SIGHT.facts())
    assert feed.newest(100.0) == SIGHT
