"""The stop zone and the slow zone, as polygons for display."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from observer.geometry import Float64Array
from observer.guard.outline import Outline, is_spot_turn, placed, poses_along
from observer.guard.parameters import GuardParameters
from observer.guard.separation import Stopping

Polygon = tuple[tuple[float, float], ...]

_CIRCLE = 16
_ALONG = 6


# Most ticks of either robot ask for the same velocity as the one before.
@lru_cache(maxsize=4)
def stop_zone(outline: Outline, wanted: tuple[float, float], p: GuardParameters) -> Polygon:
    """Return the ground, margin included, that must be free until the robot could have stopped."""
    return _zone(outline, wanted, Stopping.of(*wanted, p).way_s(), p.margin_m)


@lru_cache(maxsize=4)
def slow_zone(outline: Outline, wanted: tuple[float, float], p: GuardParameters) -> Polygon:
    """Return where an object slows the robot down: what it would reach in ``slow_time_s``."""
    way_s = max(p.slow_time_s, Stopping.of(*wanted, p).way_s())
    return _zone(outline, wanted, way_s, p.margin_m)


def _zone(outline: Outline, wanted: tuple[float, float], way_s: float, margin_m: float) -> Polygon:
    """The outline of the ground passed over, in the base frame, with the body's own sides."""
    side, front = outline.width_m / 2 + margin_m, outline.length_m / 2 + margin_m
    if wanted == (0.0, 0.0):
        return _polygon(np.array([(front, side), (-front, side), (-front, -side), (front, -side)]))
    if is_spot_turn(*wanted):
        angle = np.arange(_CIRCLE) * (2 * math.pi / _CIRCLE)
        radius = outline.radius_m + margin_m
        return _polygon(radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    ahead = math.copysign(front, wanted[0])
    poses = poses_along(*wanted, np.linspace(0.0, way_s, _ALONG))
    left = placed(np.array([(ahead, side)]), poses)[:, 0]
    right = placed(np.array([(ahead, -side)]), poses)[:, 0]
    tail = np.array([(-ahead, -side), (-ahead, side)])
    return _polygon(np.concatenate([left, right[::-1], tail]))


def _polygon(points: Float64Array) -> Polygon:
    return tuple((round(float(x), 3), round(float(y), 3)) for x, y in points)
