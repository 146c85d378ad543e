"""Sight sent to the drive process for each frame."""

from __future__ import annotations

import logging
from collections.abc import Callable

from app.engine.observed import Observed
from app.engine.wheel_feed import WheelFeed
from app.runtime.latest import LatestWriter
from observer.camera import as_gray
from observer.guard.free_path import FreePath
from observer.guard.parameters import GuardParameters
from observer.guard.seeing import sight_of_observation
from observer.guard.sight import FreeScan, Sight
from observer.mount import CameraMount

_log = logging.getLogger(__name__)


class SightWriter:
    """Writer of each observed frame's sight."""

    def __init__(self, sight: LatestWriter, wheels: WheelFeed, clock: Callable[[], float]) -> None:
        """Set the slots.

        Args:
            sight: the slot ``SIGHT_NAME``.
            wheels: tells whether a robot carries the cameras.
            clock: the host's monotonic clock.
        """
        self._sight = sight
        self._wheels = wheels
        self._clock = clock
        self._free_path: FreePath | None = None
        self._failed = False

    def write(
        self,
        observed: Observed,
        mount: CameraMount | None,
        world: str | None,
        guard: GuardParameters,
    ) -> Sight:
        """Write the sight of a frame and return it.

        Free floor is searched only if a robot may need it.

        Args:
            mount: mount of the cameras.
            world: the world that the frame shows.
            guard: the current guard parameters.
        """
        scan = None
        if mount is not None and world is not None and self._wheels.there(self._clock()):
            scan = self._scan(observed, mount, guard)
        sight = sight_of_observation(
            observed.observation, observed.camera, mount, world, scan, self._clock()
        )
        self._sight.write(sight.facts())
        return sight

    def _scan(
        self, observed: Observed, mount: CameraMount, guard: GuardParameters
    ) -> FreeScan | None:
        """Return the free scan; None without a second image, or if the floor search fails."""
        left, right = observed.trace.get("left"), observed.trace.get("right")
        if left is None or right is None:
            return None
        made_of = (observed.camera, mount, guard)
        try:
            if self._free_path is None or self._free_path.made_of != made_of:
                self._free_path = FreePath(*made_of)
            scan = self._free_path.scan(as_gray(left), as_gray(right))
        except Exception:  # noqa: BLE001
            # Without a scan nothing counts as free; observing continues.
            if not self._failed:
                _log.exception("looking for free floor failed")
            self._failed = True
            return None
        self._failed = False
        return scan
