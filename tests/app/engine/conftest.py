"""Numbered sources, for tests that need no scene."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from observer.camera import StereoCalibration
from observer.sources.contract import SkippedFrame, SourceInfo
from observer.types import StereoFrame

from .bench import Bench

RATE = 10.0
WIDTH, HEIGHT = 64, 48


def calibration() -> StereoCalibration:
    return StereoCalibration.rectified(WIDTH, HEIGHT, 60.0, 60.0, 32.0, 24.0, 0.1)


@dataclass
class NumberedSource:
    """Frames whose grey level is their number, 10 per second, starting at 100 s."""

    count: int = 5
    broken: Collection[int] = ()
    live: bool = False
    live_interval_s: float = 0.005
    own_calibration: StereoCalibration | None = field(default_factory=calibration)
    spec: str = "numbered"
    at: int = 0
    closed: int = 0

    @property
    def info(self) -> SourceInfo:
        return SourceInfo(self.spec, "numbers", WIDTH, HEIGHT, RATE, self.count, live=self.live)

    @property
    def calibration(self) -> StereoCalibration | None:
        return self.own_calibration

    def read(self) -> StereoFrame | SkippedFrame | None:
        index = self.at
        if index >= self.count:
            return None
        if self.live:
            # Nothing else paces a live source. Thousands of frames per second would fill queues
            # that no camera fills.
            time.sleep(self.live_interval_s)
        self.at += 1
        if index in self.broken:
            return SkippedFrame(index, f"frame {index} is damaged")
        image = np.full((HEIGHT, WIDTH), index % 256, dtype=np.uint8)
        return StereoFrame(index, 100.0 + index / RATE, image, image, received=-1.0)

    def rewind(self) -> None:
        self.at = 0

    def close(self) -> None:
        self.closed += 1


@pytest.fixture(scope="session")
def numbered() -> Callable[..., NumberedSource]:
    return NumberedSource


@pytest.fixture
def bench(numbered: Callable[..., Any]) -> Iterator[Bench]:
    made = Bench()
    made.sources["numbers"] = numbered(5)
    made.sources["many"] = numbered(10_000)
    with made:
        yield made
