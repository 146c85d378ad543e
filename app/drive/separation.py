"""Separation left in front of a stopped robot: from a frame and from its sonars, at rest."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from observer.guard.outline import Outline
from observer.guard.sight import Sight
from observer.robots.contract import RobotReport, SonarReading

# A surface is in the path within the robot's width plus this margin on each side.
_BESIDE_M = 0.1
# Sonars pointing further aside hear what the robot passes.
_AHEAD = math.cos(math.radians(36.0))
# A sonar silent for this long is not waited for.
_SILENT_S = 1.0


def separation(
    sight: Sight | None, report: RobotReport | None, since: float, direction: float
) -> float | None:
    """Return metres from a robot's outline to the nearest known object; None where there is none.

    Visible obstacles count wherever they are; visible surfaces, and echoes of sonars that point
    ahead, count in the path straight ahead. An echo is assumed to lie on its sonar's axis.

    Args:
        sight: of the robot at rest; None for one without cameras.
        since: the time it came to rest, the host's monotonic clock: older sonar readings do not
            count.
        direction: of the drive that was stopped, positive forward.
    """
    if report is None:
        return None
    outline = Outline.of(report.length_m, report.width_m, report.radius_m)
    distances = [
        _distance(outline, *place)
        for place in (*_echoes(report, since, direction), *_surfaces(sight))
        if _is_on_way(outline, place, direction)
    ]
    if sight is not None:
        distances += [
            max(0.0, _distance(outline, each.x, each.y) - each.radius_m) for each in sight.obstacles
        ]
    return min(distances, default=None)


def is_heard(report: RobotReport | None, since: float, direction: float) -> bool:
    """Return true if all active sonars that point ahead have reported since then."""
    return all(
        not since - _SILENT_S < each.received <= since for each in _looking(report, direction)
    )


def _looking(report: RobotReport | None, direction: float) -> Iterator[SonarReading]:
    for each in () if report is None else report.sonars:
        if math.cos(each.heading) * direction >= _AHEAD:
            yield each


def _echoes(report: RobotReport, since: float, direction: float) -> Iterator[tuple[float, float]]:
    for each in _looking(report, direction):
        if each.received > since and each.range_m is not None:
            yield (
                each.x + each.range_m * math.cos(each.heading),
                each.y + each.range_m * math.sin(each.heading),
            )


def _surfaces(sight: Sight | None) -> Iterator[tuple[float, float]]:
    if sight is None or sight.scan is None:
        return
    for bearing, blocked in zip(sight.scan.bearings, sight.scan.blocked_m, strict=True):
        if blocked is not None:
            yield blocked * math.cos(bearing), blocked * math.sin(bearing)


def _is_on_way(outline: Outline, place: tuple[float, float], direction: float) -> bool:
    x, y = place
    return x * direction > 0.0 and abs(y) <= outline.width_m / 2 + _BESIDE_M


def _distance(outline: Outline, x: float, y: float) -> float:
    return float(outline.distance(np.array(x), np.array(y)))
