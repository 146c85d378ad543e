"""Check of the perception against the true positions of all people."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from observer.evaluation.navigation.crowd import People
from observer.evaluation.navigation.perceived import FRAME_S, turned
from observer.geometry import Float64Array
from observer.guard.sight import Sight
from observer.intervals import SIGMAS_95
from observer.types import Status

# A sighting is due for a person who has been in view for this long, walks at least this fast, and
# is nearer than this.
_IN_VIEW_S, _WALKS_MPS, _FARTHEST_M = 0.5, 0.4, 5.5
# A track belongs to the nearest person within this distance plus this share of its range.
_GATE_M, _GATE_SHARE = 0.6, 0.1
_COUNTED: Final = ("frames", "usable", "due", "found", "false", "surplus", "covered")


@dataclass(frozen=True)
class PerceptionCheck:
    """Counts of one run.

    Attributes:
        frames: all; usable: those on which the guard lets the robot drive.
        due: sightings expected in usable frames. found: those made.
        false: tracks where nobody is. surplus: further tracks of one person.
        velocity_errors: m/s, of every track, alternately ahead and to the left; covered: those
            within their 95 % interval.
    """

    frames: int
    usable: int
    due: int
    found: int
    false: int
    surplus: int
    velocity_errors: tuple[float, ...]
    covered: int


@dataclass(frozen=True)
class PerceptionFigures:
    """Figures of some runs; None without data.

    Attributes:
        recall: share of the due sightings that were made. false, surplus: per 100 frames.
        velocity_median, velocity_rmse: m/s, of each component. coverage: share of the errors
            within their 95 % interval. usable: share of the frames.
    """

    frames: int
    recall: float | None
    false: float
    surplus: float
    velocity_median: float | None
    velocity_rmse: float | None
    coverage: float | None
    usable: float


@dataclass
class PerceptionChecker:
    """Follows one run frame by frame; only tracks that are confirmed and seen count."""

    _counts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(_COUNTED, 0))
    _errors: list[float] = field(default_factory=list)
    _frames_in_view: dict[int, int] = field(default_factory=dict)

    def add_sight(
        self, sight: Sight, people: People, pose: Float64Array, visible: NDArray[np.bool_]
    ) -> None:
        """Take in a sight from a pose (3,), the people at that time, and who is in view (N,)."""
        heading = float(pose[2])
        place, velocity = (
            np.array([turned(each, -heading) for each in vectors]).reshape(-1, 2)
            for vectors in (people.position - pose[:2], people.velocity)
        )
        self._count("frames")
        for number, seen in zip(people.number.tolist(), visible.tolist(), strict=True):
            self._frames_in_view[number] = self._frames_in_view.get(number, 0) + 1 if seen else 0
        found = self._matched(sight, place, velocity)
        if sight.status is not Status.OK:
            return
        self._count("usable")
        for k, number in enumerate(people.number.tolist()):
            long = (self._frames_in_view[number] - 1) * FRAME_S > _IN_VIEW_S
            walks = math.hypot(*velocity[k]) > _WALKS_MPS
            if long and walks and math.hypot(*place[k]) < _FARTHEST_M:
                self._count("due")
                self._counts["found"] += k in found

    def _matched(self, sight: Sight, place: Float64Array, velocity: Float64Array) -> set[int]:
        """Return which people are tracked; count each track as false or surplus, or its errors."""
        found: set[int] = set()
        for one in sight.obstacles:
            if one.coasting or one.id < 0:
                continue
            away = np.hypot(place[:, 0] - one.x, place[:, 1] - one.y)
            k = int(np.argmin(away)) if len(away) else -1
            if k < 0 or away[k] > _GATE_M + _GATE_SHARE * math.hypot(one.x, one.y):
                self._count("false")
            elif k in found:
                self._count("surplus")
            else:
                found.add(k)
                errors = [one.vx - float(velocity[k, 0]), one.vy - float(velocity[k, 1])]
                self._errors += errors
                most = SIGMAS_95 * (one.velocity_sigma_mps or math.inf)
                self._counts["covered"] += sum(abs(each) <= most for each in errors)
        return found

    def _count(self, what: str) -> None:
        self._counts[what] += 1

    def result(self) -> PerceptionCheck:
        """Return the counts so far."""
        return PerceptionCheck(velocity_errors=tuple(self._errors), **self._counts)


def perception_figures(checks: Sequence[PerceptionCheck]) -> PerceptionFigures | None:
    """Return the figures of some runs together; None without any."""
    frames = sum(each.frames for each in checks)
    if not frames:
        return None
    due = sum(each.due for each in checks)
    errors = np.array([error for each in checks for error in each.velocity_errors])
    known = len(errors) > 0
    return PerceptionFigures(
        frames=frames,
        recall=sum(each.found for each in checks) / due if due else None,
        false=100 * sum(each.false for each in checks) / frames,
        surplus=100 * sum(each.surplus for each in checks) / frames,
        velocity_median=float(np.median(np.abs(errors))) if known else None,
        velocity_rmse=float(np.sqrt(np.mean(errors**2))) if known else None,
        coverage=sum(each.covered for each in checks) / len(errors) if known else None,
        usable=sum(each.usable for each in checks) / frames,
    )
