"""Recent motion of a body, as a point's velocity also depends on its older sightings."""

from __future__ import annotations

from collections import deque

import numpy as np

from observer.geometry import Float64Array

# Seconds: points remember hardly anything older.
_KEPT_S = 3.5
# So many instants stand for the whole time.
_INSTANTS = 16
# Seconds: no two sightings are closer.
_LEAST_S = 1e-3


class RecentMotion:
    """Velocities and yaw rates of one body, oldest first."""

    def __init__(self) -> None:
        # Time, velocity and yaw rate; and the instants chosen from them, cached when asked for.
        self._noted: deque[tuple[float, float, float, float, float]] = deque()
        self._instants: tuple[Float64Array, Float64Array] | None = None

    def note(self, time: float, velocity: Float64Array, yaw_rate: float) -> None:
        """Note the velocity (3,) m/s and yaw rate rad/s at ``time``, s, later than all before."""
        x, y, z = velocity.tolist()
        self._noted.append((time, x, y, z, yaw_rate))
        self._instants = None
        while self._noted[0][0] < time - _KEPT_S:
            self._noted.popleft()

    @property
    def known_s(self) -> float:
        """Seconds over which the motion is known, up to now; 0 if nothing was noted."""
        return self._noted[-1][0] - self._noted[0][0] if self._noted else 0.0

    def forget(self) -> None:
        """Forget everything."""
        self._noted.clear()
        self._instants = None

    def instants(self) -> tuple[Float64Array, Float64Array]:
        """Return (T,) seconds before the newest, which comes last; (T, 4) m/s and rad/s then."""
        if self._instants is None:
            self._instants = self._chosen()
        return self._instants

    def at(self, ago: Float64Array) -> Float64Array:
        """Return (N, 4) m/s and rad/s: velocity and yaw rate (N,) seconds ago.

        Further back than they are known, the oldest ones count. At least one must be known.
        """
        known, moved = self.instants()
        columns = [np.interp(ago, known[::-1], column[::-1]) for column in moved.T]
        return np.stack(columns, axis=1)

    def acceleration(self, seconds: Float64Array) -> Float64Array:
        """Return the mean acceleration (N,) m/s^2 over the last (N,) seconds.

        Further back than it is known, the velocity counts as the oldest one.
        """
        ago, moved = self.instants()
        if len(ago) == 0:
            return np.zeros(len(seconds))
        change = np.linalg.norm(moved[:, :3] - moved[-1, :3], axis=1)
        changed = np.interp(seconds, ago[::-1], change[::-1])
        return np.asarray(changed / np.maximum(seconds, _LEAST_S), dtype=np.float64)

    def _chosen(self) -> tuple[Float64Array, Float64Array]:
        last = len(self._noted) - 1
        if last < 0:
            return np.zeros(0), np.zeros((0, 4))
        step = last / (_INSTANTS - 1)
        chosen = sorted({*(int(k * step) for k in range(_INSTANTS - 1)), last})
        rows = np.array([self._noted[k] for k in chosen])
        return rows[-1, 0] - rows[:, 0], np.ascontiguousarray(rows[:, 1:])
