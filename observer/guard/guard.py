"""Guard of the robots' speed, asked every tick of the drive loop.

It follows Nav2's collision monitor: an obstacle that would be met within ``slow_time_s`` slows the
robot in proportion (its *approach*), one within the stopping distance stops it. Unlike Nav2's, it
accounts for uncertainty and treats unknown ground as blocked. It is no certified safety function.

The rules are in ``limiting``, each robot's state from tick to tick in ``side``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from observer.guard.limiting import limit_of
from observer.guard.outline import Outline
from observer.guard.parameters import GuardParameters
from observer.guard.side import WHOLE, Side
from observer.guard.sight import SIGHT_FRESH_S, Sight
from observer.guard.zones import Polygon, slow_zone, stop_zone
from observer.rig.rig import Role
from observer.robots.contract import SonarReading
from observer.types import Status

Level = Literal["clear", "slow", "stop"]


@dataclass(frozen=True)
class Verdict:
    """Permission for a robot at this moment.

    Attributes:
        level: whether it may drive as asked, slower or not at all. Never ``clear`` while blind.
        blind: the sight that it depends on is unusable; ``reason`` says why.
        speed_mps, turn_rate_radps: permitted; scaled together, so the robot stays on its arc.
        reason: one sentence; None where nothing limits.
        limit_mps: the highest speed forward or backward along this arc; None where only the
            declared highest speed limits it.
        stop_zone, slow_zone: polygons in the base frame, metres.
        comes: whether the limit is due to something that approaches by itself, by sonar, rather
            than to something the robot drove up to.
    """

    level: Level
    blind: bool
    speed_mps: float
    turn_rate_radps: float
    reason: str | None
    limit_mps: float | None
    stop_zone: Polygon
    slow_zone: Polygon
    comes: bool = False


def sight_trouble(sight: Sight | None, now: float, world: str) -> str | None:
    """Return why a robot of a world cannot rely on this sight, one sentence; None where it can.

    Args:
        now: the host's monotonic clock. world: in which the robot drives, as ``Sight.world``.
    """
    if sight is None:
        return "no camera source is open, so nothing can be seen"
    if not sight.world:
        return "the open source is a recording, not a live view from the robot"
    if sight.world != world:
        return f"the open source shows a different world ({sight.world}) from the robot's ({world})"
    if now - sight.received > SIGHT_FRESH_S:
        age = now - sight.received
        # The exact age changes all the time; the sentence should not.
        return (
            "no camera frame for more than a second"
            if age > 1.0
            else f"no camera frame for {1e3 * SIGHT_FRESH_S:.0f} ms"
        )
    if not sight.mount_known:
        return (
            "the camera mount on the robot is unknown: enter height and tilt under Camera on the "
            "robot"
        )
    if sight.status is not Status.OK:
        why = f": {sight.reasons[0]}" if sight.reasons else ""
        return f"vision is {sight.status.value}{why}"
    return None


class Guard:
    """Limits the velocities asked of the robots; keeps its state from tick to tick by role."""

    def __init__(self, parameters: GuardParameters) -> None:
        self._parameters = parameters
        self._sides: dict[Role, Side] = {}

    def use(self, parameters: GuardParameters) -> None:
        """Use these parameters from the next tick on."""
        self._parameters = parameters

    def forget(self, role: Role) -> None:
        """Forget a role's state: another robot has the role from now on."""
        self._sides.pop(role, None)

    def limit(
        self,
        role: Role,
        wanted: tuple[float, float],
        measured: tuple[float | None, float | None],
        sight: Sight | None,
        world: str,
        sonars: tuple[SonarReading, ...],
        outline: Outline,
        now: float,
    ) -> Verdict:
        """Return which part of the wanted velocity is permitted; takes 0.3 ms.

        Args:
            wanted: m/s forward and rad/s to the left, finite. measured: the same by its encoders;
                None stands for the value permitted last.
            sight: the newest; ignored for the obstacle robot. world: in which the robot drives.
            sonars: newest readings. outline: the robot's.
            now: the host's monotonic clock. Call at least five times a second, so that the guard
                knows where the robot has driven since a frame.
        """
        p = self._parameters
        side = self._sides.get(role)
        if side is None:
            side = self._sides[role] = Side()
        side.advance(now, measured)
        wanted = _within(wanted, p)
        trouble = sight_trouble(sight, now, world) if role == "observer" else None
        if trouble is None and role == "observer":
            assert sight is not None
            side.see(sight)
        if role == "observer":
            side.watch.listen(sonars, now, side.past, p)
        zones = stop_zone(outline, wanted, p), slow_zone(outline, wanted, p)
        if trouble is not None:
            side.permitted = (0.0, 0.0)
            return Verdict("stop", True, 0.0, 0.0, trouble, 0.0, *zones)
        if wanted == (0.0, 0.0):
            side.permitted = wanted
            side.release()
            return Verdict("clear", False, 0.0, 0.0, None, None, *zones)
        seen = sight if role == "observer" else None
        limit = limit_of(side, wanted, seen, sonars, outline, p, now)
        held = side.held(limit, wanted, now, p)
        speed, turn = side.permitted = (held.share * wanted[0], held.share * wanted[1])
        if held.share >= WHOLE:
            return Verdict("clear", False, speed, turn, None, None, *zones)
        level: Level = "stop" if held.share == 0.0 else "slow"
        return Verdict(level, False, speed, turn, held.reason, abs(speed), *zones, held.comes)


def _within(wanted: tuple[float, float], p: GuardParameters) -> tuple[float, float]:
    """The wanted velocity, scaled along its arc to the highest permitted speeds."""
    speed, turn = wanted
    share = min(
        1.0,
        p.speed_max_mps / abs(speed) if speed else 1.0,
        p.turn_rate_max_radps / abs(turn) if turn else 1.0,
    )
    return share * speed, share * turn
