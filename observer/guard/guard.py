"""How fast a robot may drive at this moment: asked every tick of the drive loop.

Nav2's collision monitor is the model: what would be met within ``slow_time_s`` slows the robot in
proportion (its *approach*), what is too near to stop for stops it; here by uncertainty, and with
what is not known counted as in the way. It is no certified safety function.

What the robot passes over until it would stand again must be known to be free:

- seen free in the newest frame, carried to where the robot stands now;
- or clear by fresh sonar that covers it;
- or seen free a moment ago, as far as nothing unseen can have come in since.

A surface that is seen is in the way whatever sonar says, and an echo within ``sonar_stop_m`` ahead
whatever is seen. Tracked obstacles are followed along their own motion (``separation``), and so is
what sonar hears come nearer by itself (``intruders``). A turn on the spot asks the same of the
robot's turning circle. The obstacle robot has no eyes: only echoes limit it.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.guard.dead_reckoning import DeadReckoning, inverse, moved
from observer.guard.intruders import SonarWatch
from observer.guard.outline import Outline, is_spot_turn, swept
from observer.guard.seen_ground import RememberedGround, ScanView
from observer.guard.separation import Approach, Stopping, approach
from observer.guard.sight import SIGHT_FRESH_S, Sight
from observer.guard.sonar_clear import SonarView, clear_by_sonar, echo_at, fresh_sonar
from observer.guard.zones import Polygon, slow_zone, stop_zone
from observer.parameters import GuardParameters
from observer.rig.rig import Role
from observer.robots.contract import SonarReading
from observer.types import Status

Level = Literal["clear", "slow", "stop"]

# A share that differs by less is not worth a word.
_WHOLE = 0.999
# A turn on the spot that was stopped begins again with at least this share.
_LEAST_TURN = 0.1


@dataclass(frozen=True)
class Verdict:
    """What a robot may do at this moment.

    Attributes:
        level: whether it may drive as asked, slower or not at all. Never ``clear`` while blind.
        blind: the sight that it must go by cannot be gone by; ``reason`` says why.
        speed_mps, turn_rate_radps: permitted; scaled together, so the robot stays on its arc.
        reason: one sentence; None where nothing limits.
        limit_mps: the highest speed forth or back along this arc; None where only the declared
            highest speed limits.
        stop_zone, slow_zone: polygons in the base frame, metres.
    """

    level: Level
    blind: bool
    speed_mps: float
    turn_rate_radps: float
    reason: str | None
    limit_mps: float | None
    stop_zone: Polygon
    slow_zone: Polygon


def sight_trouble(sight: Sight | None, now: float, world: str) -> str | None:
    """Why a robot of a world cannot go by this sight, one sentence; None where it can.

    Args:
        now: the host's monotonic clock. world: in which the robot drives, as ``Sight.world``.
    """
    if sight is None:
        return "nothing is seen: no source with cameras is observed"
    if not sight.world:
        return "what is observed is a recording, not what the robot has before it"
    if sight.world != world:
        return f"what is observed is another world ({sight.world}) than the robot's ({world})"
    if now - sight.received > SIGHT_FRESH_S:
        age = now - sight.received
        # The exact age changes all the time; the sentence should not.
        return (
            "no frame came for more than a second"
            if age > 1.0
            else f"no frame came for {1e3 * SIGHT_FRESH_S:.0f} ms"
        )
    if not sight.mount_known:
        return "where the cameras sit on the robot is not known: fill in the rig's height and tilt"
    if sight.status is not Status.OK:
        why = f": {sight.reasons[0]}" if sight.reasons else ""
        return f"vision is {sight.status.value}{why}"
    return None


@dataclass(frozen=True)
class _Limit:
    """A share of the wanted velocity and why it is not the whole."""

    share: float
    reason: str | None = None


class Guard:
    """Limits what is asked of the robots; holds what it needs from tick to tick by role."""

    def __init__(self, parameters: GuardParameters) -> None:
        self._parameters = parameters
        self._sides: dict[Role, _Side] = {}

    def use(self, parameters: GuardParameters) -> None:
        """Go by these from the next tick on."""
        self._parameters = parameters

    def forget(self, role: Role) -> None:
        """Another robot has this role from now on."""
        self._sides.pop(role, None)

    def limit(
        self,
        role: Role,
        wanted: tuple[float, float],
        measured: tuple[float | None, float | None],
        sight: Sight | None,
        world: str,
        sonars: tuple[SonarReading, ...],
        radius_m: float | None,
        width_m: float | None,
        length_m: float | None,
        now: float,
    ) -> Verdict:
        """What the robot may do for what is asked of it; takes 0.2 ms.

        Args:
            wanted: m/s forward and rad/s to the left, finite. measured: the same by its encoders;
                what is not told is taken as permitted last.
            sight: the newest, of no use to the obstacle. world: in which the robot drives.
            sonars: newest readings. radius_m, width_m, length_m: its outline.
            now: the host's monotonic clock; call it at least five times a second, so that the
                guard knows where the robot has driven since a frame.
        """
        p = self._parameters
        side = self._sides.get(role)
        if side is None:
            side = self._sides[role] = _Side()
        side.advance(now, measured)
        outline = Outline.of(length_m, width_m, radius_m)
        wanted = _within(wanted, p)
        trouble = sight_trouble(sight, now, world) if role == "observer" else None
        if trouble is None and role == "observer":
            assert sight is not None
            side.see(sight)
        if role == "observer":
            side.watch.listen(sonars, now, side.past, p)
        zones = side.zones(outline, wanted, p)
        if trouble is not None:
            side.permitted = (0.0, 0.0)
            return Verdict("stop", True, 0.0, 0.0, trouble, 0.0, *zones)
        if wanted == (0.0, 0.0):
            side.permitted = wanted
            side.release()
            return Verdict("clear", False, 0.0, 0.0, None, None, *zones)
        seen = sight if role == "observer" else None
        limit = _limit(side, wanted, seen, sonars, outline, p, now)
        share, reason = side.held(limit, wanted, now, p)
        speed, turn = side.permitted = (share * wanted[0], share * wanted[1])
        if share >= _WHOLE:
            return Verdict("clear", False, speed, turn, None, None, *zones)
        level: Level = "stop" if share == 0.0 else "slow"
        return Verdict(level, False, speed, turn, reason, abs(speed), *zones)


# Of the ground passed over: places, times, which lie in the margin, and the step between times.
_Way = tuple[Float64Array, Float64Array, NDArray[np.bool_], float]


class _Side:
    """What is held of one robot from tick to tick."""

    def __init__(self) -> None:
        self.past = DeadReckoning()
        self.ground = RememberedGround()
        self.watch = SonarWatch()
        self.scan: ScanView | None = None
        self.permitted = (0.0, 0.0)
        self._frame: tuple[int, float] | None = None
        self._calls: deque[tuple[float, float, str | None]] = deque()
        self._heading: tuple[int, int] | None = None
        self._stopped = False
        self._drawn: tuple[object, tuple[Polygon, Polygon]] | None = None
        self._way: tuple[object, _Way] | None = None

    def advance(self, now: float, measured: tuple[float | None, float | None]) -> None:
        speed, turn = (
            told if known is None else known
            for known, told in zip(measured, self.permitted, strict=True)
        )
        if not self.past.advance(now, speed, turn):
            self.ground.forget()
            self.watch.forget()
            self.release()

    def zones(
        self, outline: Outline, wanted: tuple[float, float], p: GuardParameters
    ) -> tuple[Polygon, Polygon]:
        """The stop and the slow zone; most ticks want the same as the one before."""
        key = (outline, wanted, p.margin_m, p.slow_time_s, p.reaction_s, p.deceleration_mps2)
        if self._drawn is None or self._drawn[0] != key:
            self._drawn = key, (stop_zone(outline, wanted, p), slow_zone(outline, wanted, p))
        return self._drawn[1]

    def way(
        self, outline: Outline, wanted: tuple[float, float], seconds: float, margin_m: float
    ) -> _Way:
        """The ground to be passed over; most ticks want the same as the one before."""
        key = (outline, wanted, seconds, margin_m)
        if self._way is None or self._way[0] != key:
            ground = swept(outline, *wanted, seconds, margin_m)
            self._way = key, (*ground.listed(), ground.step_s)
        return self._way[1]

    def see(self, sight: Sight) -> None:
        """Take over a frame that was not there at the last tick."""
        if self._frame == (sight.frame, sight.received):
            return
        self._frame = (sight.frame, sight.received)
        self.scan = None if sight.scan is None else ScanView.of(sight.scan)
        if self.scan is not None:
            self.ground.remember(sight.received, self.scan)

    def release(self) -> None:
        """What was called for before holds no longer."""
        self._calls.clear()
        self._stopped = False

    def held(
        self, limit: _Limit, wanted: tuple[float, float], now: float, p: GuardParameters
    ) -> tuple[float, str | None]:
        """The share in force: it falls at once, and rises when less was not called for lately."""
        spot = is_spot_turn(*wanted)
        heading = (0, _sign(wanted[1])) if spot else (_sign(wanted[0]), 0)
        if heading != self._heading:
            # Making way in another direction has nothing to do with why this one was closed.
            self._heading = heading
            self.release()
        size = abs(wanted[1]) if spot else abs(wanted[0])
        while self._calls and now - self._calls[0][0] > p.release_s:
            self._calls.popleft()
        if limit.share < _WHOLE:
            self._calls.append((now, limit.share * size, limit.reason))
        if not self._calls:
            self._stopped = False
            return 1.0, None
        _, least, reason = min(self._calls, key=lambda call: call[1])
        share = min(1.0, least / size)
        # Who stands begins again only with room for more than the slowest speed.
        slowest = _LEAST_TURN * size if spot else min(p.creep_mps, size)
        enough = slowest * (1 if spot or not self._stopped else 2)
        self._stopped = share < _WHOLE and least < enough
        return (0.0 if self._stopped else share), reason


def _limit(
    side: _Side,
    wanted: tuple[float, float],
    sight: Sight | None,
    sonars: tuple[SonarReading, ...],
    outline: Outline,
    p: GuardParameters,
    now: float,
) -> _Limit:
    """The least of what tracked obstacles and the ground permit."""
    view = fresh_sonar(sonars, now, side.past, p)
    if sight is None:
        return _limit_by_echo(wanted, view, outline, p)
    age = now - sight.received
    then = side.past.then_from_now(np.array([sight.received]))[0]
    near = approach(sight.obstacles, inverse(then), age, wanted, outline, p)
    by_obstacles = _limit_by_obstacles(near, p)
    by_ground = _limit_by_ground(side, then, wanted, view, outline, p, now)
    by_coming = _limit_by_coming(side, wanted, outline, p, now)
    return min(by_obstacles, by_ground, by_coming, key=lambda one: one.share)


def _limit_by_coming(
    side: _Side, wanted: tuple[float, float], outline: Outline, p: GuardParameters, now: float
) -> _Limit:
    """What sonar hears come nearer by itself, also where no camera looks."""
    places = [one for _, several in side.watch.coming(now, side.past, p) for one in several]
    if not places:
        return _Limit(1.0)
    near = approach(places, (0.0, 0.0, 0.0), 0.0, wanted, outline, p)
    limit = _limit_by_obstacles(near, p)
    sonar = near.stopper if limit.share == near.stop_share else near.nearest
    return _Limit(limit.share, f"sonar {sonar} hears something come nearer")


def _limit_by_obstacles(near: Approach, p: GuardParameters) -> _Limit:
    slow = 1.0 if near.contact_s is None else near.contact_s / p.slow_time_s
    if near.stop_share <= min(slow, _WHOLE):
        return _Limit(near.stop_share, f"{_named(near.stopper)} is too near to stop for later")
    if slow < 1.0:
        return _Limit(slow, f"{_named(near.nearest)} would be met soon")
    return _Limit(1.0)


def _named(number: int | None) -> str:
    # A track has no lasting number yet while it is tentative.
    return "something that begins to move" if number is None or number < 0 else f"obstacle {number}"


def _limit_by_ground(
    side: _Side,
    then: Float64Array,
    wanted: tuple[float, float],
    view: SonarView | None,
    outline: Outline,
    p: GuardParameters,
    now: float,
) -> _Limit:
    stopping = Stopping.of(*wanted, p)
    stop_s = stopping.way_s()
    seconds = max(stop_s, p.slow_time_s)
    points, times, beside, step = side.way(outline, wanted, seconds, p.margin_m)
    # Beyond where the robot would stand nothing has to be known.
    needed = (times <= stop_s) & ~beside
    free = blocked = np.zeros(len(points), np.bool_)
    if side.scan is not None:
        free, blocked = side.scan.look(moved(points, then))
    echo = None
    if view is not None:
        free = free | clear_by_sonar(points, view, p)
        echo = _near_echo(points, wanted, view, outline, p)
    if echo is not None:
        return _Limit(0.0, f"sonar {echo} has an echo within {p.sonar_stop_m:.2f} m")
    unknown = needed & ~free & ~blocked
    if unknown.any():
        unknown[unknown] = ~side.ground.free(points[unknown], now, side.past, p)
    # Up to the last samples that are known to be free.
    seen_s = _first(times, blocked) - step
    known_s = min(_first(times, unknown) - step, seen_s)
    share, slow = stopping.share_within(known_s), max(0.0, seen_s / p.slow_time_s)
    if slow < min(share, _WHOLE):
        return _Limit(slow, "what stands ahead would be met soon")
    if known_s < seen_s:
        return _Limit(
            share, "the ground ahead is not known to be free: neither seen nor covered by sonar"
        )
    return _Limit(share, "what stands ahead is too near to stop for later")


def _limit_by_echo(
    wanted: tuple[float, float], view: SonarView | None, outline: Outline, p: GuardParameters
) -> _Limit:
    """Of a robot without eyes: where nothing echoes it may drive, also without any sonar."""
    if view is None or is_spot_turn(*wanted):
        return _Limit(1.0)
    stopping = Stopping.of(*wanted, p)
    way = swept(outline, *wanted, stopping.way_s(), p.margin_m)
    points, times, _ = way.listed()
    near = _near_echo(points, wanted, view, outline, p)
    if near is not None:
        return _Limit(0.0, f"sonar {near} has an echo within {p.sonar_stop_m:.2f} m")
    echoed = np.asarray(echo_at(points, view, p).any(axis=0), np.bool_)
    share = stopping.share_within(_first(times, echoed) - way.step_s)
    return _Limit(share, "the sonar has an echo ahead")


def _near_echo(
    points: Float64Array,
    wanted: tuple[float, float],
    view: SonarView,
    outline: Outline,
    p: GuardParameters,
) -> int | None:
    """The number of a sonar with an echo on the way within the stop distance.

    What stands beside the robot does not keep it from turning away.
    """
    if is_spot_turn(*wanted):
        return None
    near = points[outline.distance(points[:, 0], points[:, 1]) <= p.sonar_stop_m]
    echoing = echo_at(near, view, p).any(axis=1)
    return view.index[int(np.argmax(echoing))] if echoing.any() else None


def _first(times: Float64Array, which: NDArray[np.bool_]) -> float:
    return float(times[which].min()) if which.any() else math.inf


def _within(wanted: tuple[float, float], p: GuardParameters) -> tuple[float, float]:
    """The wanted velocity on its arc, no faster than is ever permitted."""
    speed, turn = wanted
    share = min(
        1.0,
        p.speed_max_mps / abs(speed) if speed else 1.0,
        p.turn_rate_max_radps / abs(turn) if turn else 1.0,
    )
    return share * speed, share * turn


def _sign(value: float) -> int:
    return (value > 0) - (value < 0)
