"""State of the guard for one robot from tick to tick: what it knows and what it has permitted."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from observer.guard.dead_reckoning import DeadReckoning
from observer.guard.intruders import SonarWatch
from observer.guard.outline import is_spot_turn
from observer.guard.parameters import GuardParameters
from observer.guard.seen_ground import RememberedGround, ScanView
from observer.guard.seen_surfaces import RememberedSurfaces
from observer.guard.sight import Sight

# A share above this counts as the whole.
WHOLE = 0.999
# Share: a stopped turn on the spot starts again with at least this.
_LEAST_TURN = 0.1


@dataclass(frozen=True)
class Limit:
    """Permitted share of the wanted velocity, and why it is not the whole.

    Attributes:
        comes: whether the limit is due to something that approaches by itself, by sonar, rather
            than to something the robot drove up to.
    """

    share: float
    reason: str | None = None
    comes: bool = False


class Side:
    """State of the guard for one robot.

    Attributes:
        past: where it was. ground: what was seen free a moment ago. surfaces: what was seen in the
            way and is now too near to be seen. watch: what its sonar hears.
        scan: of the newest frame. permitted: m/s and rad/s at the last tick.
    """

    def __init__(self) -> None:
        self.past = DeadReckoning()
        self.ground = RememberedGround()
        self.surfaces = RememberedSurfaces()
        self.watch = SonarWatch()
        self.scan: ScanView | None = None
        self.permitted = (0.0, 0.0)
        self._frame: tuple[int, float] | None = None
        self._calls: deque[tuple[float, float, Limit]] = deque()
        self._heading: tuple[int, int] | None = None
        self._stopped = False

    def advance(self, now: float, measured: tuple[float | None, float | None]) -> None:
        """Take in the measured velocity; forget what was free if the motion since is unknown."""
        speed, turn = (
            permitted if known is None else known
            for known, permitted in zip(measured, self.permitted, strict=True)
        )
        before = self.past.now
        if not self.past.advance(now, speed, turn):
            # Surfaces are kept: the robot has hardly moved, and forgetting them would permit more.
            self.ground.forget()
            self.watch.forget()
            self.release()
        elif before is not None:
            self.surfaces.carry(self.past.then_from_now(np.array([before]))[0])

    def see(self, sight: Sight) -> None:
        """Take in a frame if it is new since the last tick."""
        if self._frame == (sight.frame, sight.received):
            return
        self._frame = (sight.frame, sight.received)
        self.scan = None if sight.scan is None else ScanView.of(sight.scan)
        if self.scan is not None:
            self.ground.remember(sight.received, self.scan)
            then = self.past.then_from_now(np.array([sight.received]))[0]
            self.surfaces.see(self.scan, then)

    def release(self) -> None:
        """Forget the earlier limits."""
        self._calls.clear()
        self._stopped = False

    def held(
        self, limit: Limit, wanted: tuple[float, float], now: float, p: GuardParameters
    ) -> Limit:
        """Return the current limit: it falls at once, and rises only after ``release_s``.

        Args:
            limit: of the wanted velocity, at this moment.
        """
        spot = is_spot_turn(*wanted)
        heading = (0, _sign(wanted[1])) if spot else (_sign(wanted[0]), 0)
        if heading != self._heading:
            # The limits of one direction do not apply to another.
            self._heading = heading
            self.release()
        size = abs(wanted[1]) if spot else abs(wanted[0])
        while self._calls and now - self._calls[0][0] > p.release_s:
            self._calls.popleft()
        if limit.share < WHOLE:
            self._calls.append((now, limit.share * size, limit))
        if not self._calls:
            self._stopped = False
            return Limit(1.0)
        _, least, called = min(self._calls, key=lambda call: call[1])
        share = min(1.0, least / size)
        # A stopped robot starts again only with room for twice the slowest speed.
        slowest = _LEAST_TURN * size if spot else min(p.creep_mps, size)
        enough = slowest * (1 if spot or not self._stopped else 2)
        self._stopped = share < WHOLE and least < enough
        return replace(called, share=0.0 if self._stopped else share)


def _sign(value: float) -> int:
    return (value > 0) - (value < 0)
