"""Sight sent to the drive process for each frame, and wheel odometry read back from it."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

from app.engine.observed import Observed
from app.runtime.latest import LatestReader, LatestWriter
from observer.camera import as_gray
from observer.guard.free_path import FreePath
from observer.guard.parameters import GuardParameters
from observer.guard.seeing import sight_of_observation
from observer.guard.sight import FreeScan
from observer.mount import CameraMount
from observer.rig.rig import Role
from observer.rig.wheel_history import odometry_at
from observer.types import Odometry

_log = logging.getLogger(__name__)

# Role of the robot that carries the cameras.
_OBSERVER: Role = "observer"
# A robot whose newest odometry is older than this is gone.
_GONE_S = 1.0


class SightTeller:
    """Writer of each observed frame's sight and reader of the wheels."""

    def __init__(
        self, sight: LatestWriter, wheels: LatestReader, clock: Callable[[], float]
    ) -> None:
        """Set the slots.

        Args:
            sight: the slot ``SIGHT_NAME``.
            wheels: the slot ``WHEELS_NAME``.
            clock: the host's monotonic clock.
        """
        self._sight = sight
        self._wheels = wheels
        self._clock = clock
        self._sequence = 0
        self._history: list[list[float]] = []
        self._free_path: FreePath | None = None
        self._failed = False

    def tell(
        self,
        observed: Observed,
        mount: CameraMount | None,
        world: str | None,
        guard: GuardParameters,
    ) -> None:
        """Write the sight of a frame. Free floor is searched only where a robot may need it.

        Args:
            mount: of the cameras.
            world: the world that the frame shows.
            guard: the parameters in force.
        """
        scan = None
        if mount is not None and world is not None and self._robot_is_there():
            scan = self._scan(observed, mount, guard)
        sight = sight_of_observation(
            observed.observation, observed.camera, mount, world, scan, self._clock()
        )
        self._sight.write(sight.facts())

    def odometry(self, received: float) -> Odometry | None:
        """Return the observer's odometry when a frame was received; None without any."""
        return odometry_at(self._read_history(), received)

    def _robot_is_there(self) -> bool:
        history = self._read_history()
        return bool(history) and self._clock() - history[-1][0] <= _GONE_S

    def _read_history(self) -> list[list[float]]:
        value = self._wheels.read(self._sequence)
        if value is not None:
            self._sequence = value.sequence
            self._history = _rows(value.header)
        return self._history

    def _scan(
        self, observed: Observed, mount: CameraMount, guard: GuardParameters
    ) -> FreeScan | None:
        """Return the free scan; None without a second image, or where the floor search fails."""
        left, right = observed.trace.get("left"), observed.trace.get("right")
        if left is None or right is None:
            return None
        search = observed.parameters.stereo.max_disparity_px
        made_of = (observed.camera, mount, search, guard)
        try:
            if self._free_path is None or self._free_path.made_of != made_of:
                self._free_path = FreePath(*made_of)
            scan = self._free_path.scan(as_gray(left), as_gray(right))
        except Exception:  # noqa: BLE001
            # Without it nothing is known to be free; observing continues.
            if not self._failed:
                _log.exception("looking for free floor failed")
            self._failed = True
            return None
        self._failed = False
        return scan


def _rows(header: dict[str, Any]) -> list[list[float]]:
    rows = header.get(_OBSERVER, [])
    try:
        return [[float(value) for value in row] for row in rows if len(row) == 4]
    except (TypeError, ValueError):
        return []
