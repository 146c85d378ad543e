"""Loan of a live source from one session to the next: only one program can open its cameras.

The robots of its world, if it has any, pass along, so that their driver need not reconnect.
"""

from __future__ import annotations

from observer.camera import StereoCalibration
from observer.opening import OpenedSource
from observer.robots.contract import RobotPort, RobotWorld
from observer.sources.contract import (
    LiveReport,
    LiveSource,
    NoFrame,
    SkippedFrame,
    Source,
    SourceInfo,
)
from observer.types import StereoFrame


class LentSource:
    """Live source that stays open for its old session until the new one owns it for good."""

    def __init__(self, source: Source) -> None:
        self._source: Source = source._source if isinstance(source, LentSource) else source
        self._kept = False

    def keep(self) -> None:
        """Make ``close`` close the source from now on."""
        self._kept = True

    @property
    def info(self) -> SourceInfo:
        return self._source.info

    @property
    def calibration(self) -> StereoCalibration | None:
        return self._source.calibration

    def read(self) -> StereoFrame | SkippedFrame | NoFrame | None:
        return self._source.read()

    def rewind(self) -> None:
        self._source.rewind()

    def tend(self) -> None:
        """Let the source decode the next pair ahead."""
        assert isinstance(self._source, LiveSource)
        self._source.tend()

    def report(self) -> LiveReport:
        """Return the state of its cameras."""
        assert isinstance(self._source, LiveSource)
        return self._source.report()

    def close(self) -> None:
        if self._kept:
            self._source.close()


class LentRobots:
    """Robots of a lent source's world."""

    def __init__(self, robots: RobotWorld) -> None:
        self._robots: RobotWorld = robots._robots if isinstance(robots, LentRobots) else robots
        self._kept = False

    def keep(self) -> None:
        """Make ``close`` close them from now on."""
        self._kept = True

    @property
    def world(self) -> str:
        return self._robots.world

    def serve(self) -> tuple[RobotPort, ...]:
        return self._robots.serve()

    def close(self) -> None:
        if self._kept:
            self._robots.close()


def lent(source: Source, robots: RobotWorld | None = None) -> OpenedSource:
    """Return the source as if newly opened; nothing live has truth."""
    return OpenedSource(LentSource(source), None, None if robots is None else LentRobots(robots))
