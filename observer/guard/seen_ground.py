"""Ground that is seen to be free, now and a moment ago."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.guard.dead_reckoning import DeadReckoning, moved
from observer.guard.parameters import GuardParameters
from observer.guard.sight import FreeScan

# A surface is assumed this much nearer than reported, in addition to its uncertainty.
_SURFACE_ERROR_M = 0.03
# A surface is gone if everything in its direction is at least this much farther away, metres.
_GONE_M = 0.15
# Seconds between remembered scans, and how many of them are consulted.
_APART_S = 0.15
_ASKED = 3
# Scans so old that an intruder could have come farther than this are not used.
_FARTHEST_INTRUSION_M = 0.6
_AROUND = 8


@dataclass(frozen=True, eq=False)
class ScanView:
    """A scan with the worse of every two neighbouring bearings, prepared for queries.

    Attributes:
        bearings: (N,) ascending. near, far, blocked, blind: (N + 1,) of the gap below each bearing;
            the first and the last are outside the view, where nothing is known.
    """

    bearings: Float64Array
    near: Float64Array
    far: Float64Array
    blocked: Float64Array
    blind: Float64Array

    @staticmethod
    def of(scan: FreeScan) -> ScanView:
        near, far = np.array(scan.known_from_m), np.array(scan.known_to_m)
        blocked = np.array([np.inf if b is None else b for b in scan.blocked_m])
        blind = np.array(scan.blind_m or (0.0,) * len(scan.bearings))
        # Nothing is seen beyond a surface.
        far = np.minimum(far, blocked)
        return ScanView(
            np.array(scan.bearings),
            np.r_[np.inf, np.maximum(near[:-1], near[1:]), np.inf],
            np.r_[-np.inf, np.minimum(far[:-1], far[1:]), -np.inf],
            np.r_[np.inf, np.minimum(blocked[:-1], blocked[1:]), np.inf],
            np.r_[np.inf, np.maximum(blind[:-1], blind[1:]), np.inf],
        )

    @property
    def farthest_blind_m(self) -> float:
        """Distance from which on surfaces are measured in all directions of the view."""
        return float(self.blind[1:-1].max(initial=0.0))

    def classify(self, points: Float64Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which points (N, 2) of the scan's base frame are seen free and which blocked."""
        if len(self.bearings) < 2:
            nothing = np.zeros(len(points), np.bool_)
            return nothing, nothing
        x, y = points[:, 0], points[:, 1]
        gap = np.searchsorted(self.bearings, np.arctan2(y, x))
        distance = np.hypot(x, y)
        free = (distance >= self.near[gap]) & (distance <= self.far[gap])
        blocked = distance >= self.blocked[gap] - _SURFACE_ERROR_M
        return free & ~blocked, blocked

    def surfaces(self, reach_m: float) -> Float64Array:
        """(M, 2) places of the surfaces that are barely far enough away to be measured.

        Args:
            reach_m: farther than the nearest distance at which one is measured.
        """
        blocked = self.blocked[1:-1]
        near = blocked <= self.blind[1:-1] + reach_m
        angle, distance = (self.bearings[:-1] + self.bearings[1:])[near] / 2, blocked[near]
        return np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=1)

    def shows_gone(self, places: Float64Array) -> NDArray[np.bool_]:
        """Return at which places (N, 2) a surface would be seen, and the scene is farther."""
        gap = np.searchsorted(self.bearings, np.arctan2(places[:, 1], places[:, 0]))
        distance = np.hypot(places[:, 0], places[:, 1])
        measured = distance > self.blind[gap] + _SURFACE_ERROR_M
        return np.asarray(measured & (self.blocked[gap] > distance + _GONE_M), np.bool_)


class RememberedGround:
    """Recent scans, and which ground they still show to be free."""

    def __init__(self) -> None:
        self._scans: deque[tuple[float, ScanView]] = deque(maxlen=64)

    def forget(self) -> None:
        self._scans.clear()

    def remember(self, received: float, view: ScanView) -> None:
        """Keep a scan, unless the last one was kept a moment ago."""
        if not self._scans or received - self._scans[-1][0] >= _APART_S:
            self._scans.append((received, view))

    def free(
        self, points: Float64Array, now: float, past: DeadReckoning, p: GuardParameters
    ) -> NDArray[np.bool_]:
        """Return which points (N, 2) of the current base frame must still be free as once seen.

        All ground around a point must have been free, out to the distance that something unseen
        may have travelled since at ``intruder_mps``.
        """
        found = np.zeros(len(points), np.bool_)
        while self._scans and now - self._scans[0][0] > p.memory_s:
            self._scans.popleft()
        angle = np.arange(_AROUND) * (2 * math.pi / _AROUND)
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        near_enough = [
            (received, view)
            for received, view in self._scans
            if (now - received) * p.intruder_mps <= _FARTHEST_INTRUSION_M
        ]
        for received, view in _spread(near_enough):
            left = ~found
            if not left.any():
                break
            pose = past.then_from_now(np.array([received]))[0]
            then = moved(points[left], pose)
            radius = (now - received) * p.intruder_mps
            around = then[:, None, :] + radius * circle
            free, _ = view.classify(np.concatenate([then, around.reshape(-1, 2)]))
            whole = free[: len(then)] & free[len(then) :].reshape(len(then), _AROUND).all(axis=1)
            found[left] = whole
        return found


def _spread(scans: list[tuple[float, ScanView]]) -> list[tuple[float, ScanView]]:
    """Return at most ``_ASKED`` of them, from the newest to the oldest."""
    if len(scans) <= _ASKED:
        return scans[::-1]
    picked = np.linspace(len(scans) - 1, 0, _ASKED).round().astype(int)
    return [scans[k] for k in picked]
