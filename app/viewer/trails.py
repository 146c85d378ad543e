"""Trails of the camera and the obstacles."""

from __future__ import annotations

from collections import deque

import numpy as np

from app.viewer.shapes import trail_segments
from observer.geometry import Float64Array

# Every line costs time with software rendering, whether it is in use or not.
MOST_CAMERA_POINTS = 150
_OBSTACLE_POINTS = 40
_LEAST_STEP_M = 0.06
# Trails of lost obstacles remain for this long.
_KEPT_S = 4.0


class Trails:
    """Positions over time, world frame, forgotten with the segment."""

    def __init__(self) -> None:
        self._camera: deque[Float64Array] = deque(maxlen=MOST_CAMERA_POINTS)
        self._obstacles: dict[int, tuple[float, deque[Float64Array]]] = {}

    def clear(self) -> None:
        self._camera.clear()
        self._obstacles.clear()

    def add_camera(self, position: Float64Array) -> None:
        _add(self._camera, position)

    def add_obstacle(self, id: int, position: Float64Array, now: float) -> None:
        points = self._obstacles.get(id, (now, deque(maxlen=_OBSTACLE_POINTS)))[1]
        _add(points, position)
        self._obstacles[id] = (now, points)

    def forget_gone(self, now: float) -> None:
        """Drop the trails of obstacles not seen for a while."""
        gone = [id for id, (seen, _) in self._obstacles.items() if now - seen > _KEPT_S]
        for id in gone:
            del self._obstacles[id]

    @property
    def camera(self) -> Float64Array:
        """Return (N, 2, 3) lines of the camera's trail."""
        return trail_segments(self._camera)

    @property
    def obstacles(self) -> Float64Array:
        """Return (N, 2, 3) lines of all obstacles' trails together."""
        lines = [trail_segments(points) for _, points in self._obstacles.values()]
        return np.concatenate(lines) if lines else np.zeros((0, 2, 3))


def _add(points: deque[Float64Array], position: Float64Array) -> None:
    if not points or float(np.linalg.norm(position - points[-1])) >= _LEAST_STEP_M:
        points.append(position)
