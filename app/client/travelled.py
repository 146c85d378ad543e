"""Summary of a robot's commanded and measured motion, from the server's facts."""

from __future__ import annotations

import math

from app.contract.values import JsonObject


class Travelled:
    """Summary for one robot; feed it the facts of its role a few times a second or more."""

    def __init__(self) -> None:
        self._time: float | None = None
        self._commanded = _Course()
        self._sent = _Course()
        self._encoder = _Course()
        self._place: tuple[float, float] | None = None
        self._driven_m: float | None = None

    def add(self, facts: JsonObject, now: float) -> None:
        """Add the state at ``now``, in seconds on any monotonic clock."""
        dt = 0.0 if self._time is None else now - self._time
        self._time = now
        report = facts.get("report") or {}
        self._commanded.add((facts.get("commanded") or {}).get("speed_mps"), dt)
        self._sent.add((facts.get("sent") or {}).get("speed_mps"), dt)
        self._encoder.add(report.get("speed_mps"), dt)
        odometry = report.get("odometry")
        if odometry is not None:
            here = (odometry["x"], odometry["y"])
            step = math.dist(self._place, here) if self._place is not None else 0.0
            self._place = here
            self._driven_m = (self._driven_m or 0.0) + step

    def summary(self) -> dict[str, float | None]:
        """Return path lengths in metres, whatever the course, and top speeds in m/s; None if
        unknown.
        """
        return {
            "commanded_distance_m": self._commanded.distance_m,
            "sent_distance_m": self._sent.distance_m,
            "encoder_distance_m": None if self._driven_m is None else round(self._driven_m, 4),
            "commanded_speed_max_mps": self._commanded.fastest_mps,
            "sent_speed_max_mps": self._sent.fastest_mps,
            "encoder_speed_max_mps": self._encoder.fastest_mps,
        }


class _Course:
    """Speed over time."""

    def __init__(self) -> None:
        self._last: float | None = None
        self._distance_m: float | None = None
        self._fastest: float | None = None

    def add(self, speed: float | None, dt: float) -> None:
        if speed is not None:
            if self._last is not None:
                self._distance_m = (self._distance_m or 0.0) + dt * (
                    abs(self._last) + abs(speed)
                ) / 2
            self._fastest = max(abs(speed), self._fastest or 0.0)
        self._last = speed

    @property
    def distance_m(self) -> float | None:
        return None if self._distance_m is None else round(self._distance_m, 4)

    @property
    def fastest_mps(self) -> float | None:
        return None if self._fastest is None else round(self._fastest, 4)
