"""Measurement of every stop of a moving robot, from its cause until the robot stands.

It runs at the end of each tick, commands nothing and reads no clock.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

from app.contract.drive import IncidentEvent, StoppedEvent
from app.drive.consent import ZERO
from app.drive.driven_role import DrivenRole
from app.drive.roles import Roles
from app.drive.separation import is_heard, separation
from observer.guard.guard import Verdict, sight_trouble
from observer.guard.sight import Sight
from observer.rig.rig import Role
from observer.robots.contract import RobotPhase, RobotReport

# Below this encoder speed the robot stands.
STATIONARY_MPS = 0.01
# A stop is followed for this long: it covers a firmware watchdog of 2 s and the braking after it.
_FOLLOWED_S = 4.0
# Waiting time for a frame and sonar readings of the robot at rest, for the separation.
_LOOK_S = 0.5
_KEPT_S = 6.0
# Counters of a robot that rise where its odometry left out a motion: it was not connected, or its
# own numbers were reset.
_GAPS = ("reconnects", "odometry_jumps")


@dataclass(frozen=True)
class _Packet:
    """Status packet's content; metres in the odometry's frame, m/s.

    Attributes:
        gaps: number of gaps in the odometry so far.
    """

    received: float
    place: tuple[float, float] | None
    speed_mps: float | None
    gaps: int


@dataclass
class _Stop:
    """Stop that is being measured."""

    incident: IncidentEvent
    cause: float
    speed_mps: float | None
    before_mps: float | None
    came: bool
    zero: float | None = None
    stood: float | None = None


class StopWatch:
    """Measurement of one role's stops, one after the other.

    Anything that happens while a stop is being measured belongs to it, even the motors' switching
    off afterwards.
    """

    def __init__(self, role: Role) -> None:
        self._role = role
        self._packets: deque[_Packet] = deque()
        self._open: _Stop | None = None
        # As of the previous tick.
        self._sent = ZERO
        self._sign: float | None = None
        self._seen: float | None = None
        self._slowed: float | None = None
        self._zero: float | None = None

    def update(
        self, now: float, roles: Roles, incidents: Iterable[IncidentEvent]
    ) -> StoppedEvent | None:
        """Process this tick; return a stop whose end is now known.

        Args:
            now: the host's monotonic clock.
            incidents: those since the last call.
        """
        driven, sight = roles.driven[self._role], roles.sight
        report = driven.report
        if driven.robot is None:
            self._packets.clear()
        else:
            self._take(report, now)
        self._zero = _zero_since(self._zero, driven, report, now)
        for incident in incidents:
            if self._open is None and self._concerns(incident):
                self._open = self._start_stop(incident, report, driven.verdict)
        stopped = None if self._open is None else self._followed(self._open, now, driven, sight)
        if stopped is not None:
            self._open = None
        self._remember(now, driven, sight)
        return stopped

    def _concerns(self, incident: IncidentEvent) -> bool:
        if incident.kind in ("programme", "goal"):
            # This incident concerns a programme or goal; the event that stopped its robots has an
            # incident of its own.
            return False
        return incident.role in (self._role, None)

    def _take(self, report: RobotReport | None, now: float) -> None:
        if report is None or report.phase is not RobotPhase.CONNECTED or report.received is None:
            return
        packets, place = self._packets, report.odometry
        if not packets or report.received > packets[-1].received:
            packets.append(
                _Packet(
                    report.received,
                    None if place is None else (place.x, place.y),
                    report.speed_mps,
                    sum(report.counters.get(name, 0) for name in _GAPS),
                )
            )
        while now - packets[0].received > _KEPT_S and len(packets) > 1:
            packets.popleft()

    def _remember(self, now: float, driven: DrivenRole, sight: Sight | None) -> None:
        self._sent = driven.sent
        if driven.consent.sign is not None:
            self._sign = driven.consent.sign
        verdict = driven.verdict
        if sight is not None and self._good(sight, now, driven):
            self._seen = sight.received
        if verdict is None or verdict.level == "clear":
            self._slowed = None
        elif self._slowed is None and not verdict.blind:
            self._slowed = now

    def _good(self, sight: Sight, now: float, driven: DrivenRole) -> bool:
        connection, verdict = driven.connection, driven.verdict
        if connection is None or (verdict is not None and verdict.blind):
            return False
        return sight_trouble(sight, now, connection.world) is None

    # --- from its cause --------------------------------------------------------------------

    def _start_stop(
        self, incident: IncidentEvent, report: RobotReport | None, verdict: Verdict | None
    ) -> _Stop | None:
        """Begin measuring a stop; return None where nothing was moving."""
        cause = self._cause(incident, report)
        speed, lately = self._speed_at(cause), self._speed_at(incident.time)
        if speed is not None and abs(speed) < STATIONARY_MPS:
            return None
        if self._sent == ZERO and (lately is None or abs(lately) < STATIONARY_MPS):
            # Whatever the cause, the robot stands already.
            return None
        before = speed
        if incident.kind == "guard" and self._slowed is not None:
            before = self._speed_at(self._slowed)
        return _Stop(incident, cause, speed, before, verdict is not None and verdict.comes)

    def _cause(self, incident: IncidentEvent, report: RobotReport | None) -> float:
        """Return the last moment at which all was well, as far as it is known."""
        known: float | None = None
        match incident.kind:
            case "sight":
                known = self._seen
            case "expired" | "lease":
                known = self._sign
            case "fault":
                known = None if report is None else report.received
                if known is None and self._packets:
                    known = self._packets[-1].received
            case _:
                pass
        return incident.time if known is None else min(known, incident.time)

    def _speed_at(self, moment: float) -> float | None:
        """Return the speed in the newest packet until then, or in the oldest if all came later."""
        before = [each for each in self._packets if each.received <= moment]
        if before:
            return before[-1].speed_mps
        return self._packets[0].speed_mps if self._packets else None

    # --- to its end ------------------------------------------------------------------------

    def _followed(
        self, stop: _Stop, now: float, driven: DrivenRole, sight: Sight | None
    ) -> StoppedEvent | None:
        """Return the stop once its measurement is complete."""
        if stop.zero is None and self._zero is not None:
            # Zero may have been sent before the cause: the driver of a stalled robot sends it by
            # itself.
            stop.zero = max(self._zero, stop.cause)
        if stop.stood is None:
            stop.stood = self._stood(stop.cause)
        if stop.zero is not None and stop.stood is not None:
            return self._look_ahead(stop, now, driven, sight)
        over = (
            now - stop.cause > _FOLLOWED_S
            or driven.robot is None
            or (stop.zero is not None and (stop.speed_mps is None or driven.sent != ZERO))
        )
        return self._stopped_event(stop, None) if over else None

    def _stood(self, cause: float) -> float | None:
        for packet in self._packets:
            speed = packet.speed_mps
            if packet.received > cause and speed is not None and abs(speed) < STATIONARY_MPS:
                return packet.received
        return None

    def _look_ahead(
        self, stop: _Stop, now: float, driven: DrivenRole, sight: Sight | None
    ) -> StoppedEvent | None:
        """Return a guard's stop with the separation left in front of the robot at rest."""
        assert stop.stood is not None
        if stop.incident.kind != "guard" or stop.came:
            # An obstacle that approached by itself may come nearer still.
            return self._stopped_event(stop, None)
        direction = math.copysign(1.0, stop.speed_mps or 0.0)
        over = now - stop.stood > _LOOK_S
        if not over and not is_heard(driven.report, stop.stood, direction):
            return None
        if self._role != "observer":
            return self._stopped_event(stop, separation(None, driven.report, stop.stood, direction))
        if sight is not None and sight.received >= stop.stood and self._good(sight, now, driven):
            return self._stopped_event(
                stop, separation(sight, driven.report, stop.stood, direction)
            )
        # Sonar alone does not report what only a camera would see.
        return self._stopped_event(stop, None) if over else None

    def _stopped_event(self, stop: _Stop, separation_m: float | None) -> StoppedEvent:
        return StoppedEvent(
            role=self._role,
            kind=stop.incident.kind,
            sentence=stop.incident.sentence,
            incident_time=stop.incident.time,
            cause_time=stop.cause,
            zero_time=stop.zero,
            stood_time=stop.stood,
            speed_mps=stop.speed_mps,
            before_mps=stop.before_mps,
            distance_m=None if stop.stood is None else self._driven_m(stop.cause, stop.stood),
            separation_m=separation_m,
        )

    def _driven_m(self, start: float, end: float) -> float | None:
        """Return the odometry's path length between two moments, at even speed between packets.

        Return None if it is not known, as after a gap in the odometry.
        """
        packets = [each for each in self._packets if each.received <= end]
        within = [each for each in packets if each.received > start]
        before = packets[: len(packets) - len(within)]
        if not before or not within or before[-1].gaps != within[-1].gaps:
            return None
        places = [each.place for each in (before[-1], *within)]
        known = [place for place in places if place is not None]
        if len(known) < len(places):
            return None
        steps = [math.dist(one, other) for one, other in itertools.pairwise(known)]
        first, second = before[-1].received, within[0].received
        steps[0] *= (second - start) / (second - first)
        return sum(steps)


def _zero_since(
    before: float | None, driven: DrivenRole, report: RobotReport | None, now: float
) -> float | None:
    """Return the time since which zero is sent; None while anything else is, or if unknown."""
    if driven.robot is None or report is None:
        return before
    sent = report.sent
    if sent is None:
        # The robot does not report what its port sent: use the velocity handed to its driver.
        return None if driven.sent != ZERO else now if before is None else before
    if sent.speed_mps != 0.0 or sent.turn_rate_radps != 0.0:
        return None
    return sent.time if before is None else before
