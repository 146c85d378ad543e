"""One role: its robot, whether it is armed, and what it is sent at this moment.

Nothing here waits or looks at a clock; the loop tells the time. The states::

    no robot --ConnectRobot--> connecting --> disarmed --ArmRobot--> armed <--> moving
                               waiting, refused   ^------- whatever disarms ------'

"""

from __future__ import annotations

import logging
from typing import Literal

from app.contract.drive import IncidentEvent, IncidentKind
from app.drive import reasons
from app.drive.connection import Connection, Tick
from app.drive.consent import ZERO, Consent, Velocity
from app.drive.guarding import Guarding, least
from app.drive.ramp import ramped
from app.runtime.errors import ProcessRefused
from observer.guard.guard import Verdict, sight_trouble
from observer.rig.rig import Role
from observer.robots.contract import Explained, Robot, RobotPhase, RobotReport, Sent

_log = logging.getLogger(__name__)

# What would expire before the next tick counts no more at this one: nothing moves by a command
# that is too old, and a tick that comes late has that much to spare.
_NEXT_LOOK_S = 0.02
# Without sight for this long the observer is disarmed.
BLIND_S = 1.0
_EXPIRED = "no command or sign of presence came in time"
_GUARD_FAILED = "the guard failed; see the drive process's messages"

State = Literal["connecting", "disarmed", "armed", "moving", "waiting", "refused"]


class DrivenRole:
    """See the module.

    Attributes:
        connection: None while no robot was asked for.
        consent: of who holds its lease.
        armed: its motors may be on.
        asked: velocity that is asked for, whether or not it may be driven.
        sent: velocity that really went out last.
        hindrance: why it does not drive as asked, one sentence.
        why_disarmed: what took its motors away last.
        verdict: the guard's last one.
        report: the robot's last one.
    """

    def __init__(self, role: Role, guard: Guarding) -> None:
        self.role: Role = role
        self._guard = guard
        self.connection: Connection | None = None
        self.consent = Consent()
        self.armed = False
        self.asked = ZERO
        self.sent = ZERO
        # Where the ramp goes on from: ports round what is sent, and many a step is below that.
        self._reached = ZERO
        self.hindrance: str | None = None
        self.why_disarmed: str | None = None
        self.verdict: Verdict | None = None
        self.report: RobotReport | None = None
        self._blind_since: float | None = None
        self._incidents: list[IncidentEvent] = []

    # --- connection ------------------------------------------------------------------------

    @property
    def robot(self) -> Robot | None:
        """What is driven, once it is opened."""
        return None if self.connection is None else self.connection.robot

    @property
    def state(self) -> State | None:
        """In one word; None without a robot."""
        connection, report = self.connection, self.report
        if connection is None:
            return None
        if connection.trouble is not None:
            return "refused"
        if report is None or report.phase is RobotPhase.CONNECTING:
            return "connecting"
        if report.phase is RobotPhase.REFUSED:
            return "refused"
        if report.phase is not RobotPhase.CONNECTED:
            return "waiting"
        if not self.armed:
            return "disarmed"
        return "armed" if self.sent == ZERO else "moving"

    def connect(self, connection: Connection | None) -> Robot | None:
        """Have another robot, or none; the one before, at zero, is for the caller to close."""
        before = self.robot
        if before is not None:
            before.disable()
        self.connection = connection
        self.armed = False
        self.asked = self.sent = self._reached = ZERO
        self.consent.withdraw()
        self.hindrance = self.why_disarmed = self.verdict = self.report = None
        self._blind_since = None
        self._guard.forget(self.role)
        return before

    def let_go(self) -> Robot | None:
        """Give the robot up, without another word to it; it is for the caller to close."""
        robot, self.connection = self.robot, None
        self.armed = False
        self.sent = self._reached = ZERO
        return robot

    # --- arming ----------------------------------------------------------------------------

    def arm(self, tick: Tick) -> None:
        """Motors on, at zero.

        Raises:
            ProcessRefused: one sentence of what is missing.
        """
        if self.robot is not None:
            self.report = self.robot.report()
        missing = reasons.missing_to_arm(self.role, self.connection, self.report, tick)
        if missing is not None:
            raise ProcessRefused(missing, "state")
        robot = self.robot
        assert robot is not None
        if self.armed:
            return
        robot.enable()
        self.armed = True
        self.sent = self._reached = ZERO
        self.why_disarmed = None
        self._blind_since = None
        self.consent.arm()

    def disarm(
        self, now: float, kind: IncidentKind | None = None, sentence: str | None = None
    ) -> None:
        """Zero, motors off.

        Args:
            kind, sentence: of the incident that this is; None where somebody simply wanted it.
        """
        robot = self.robot
        self._still(now, kind if self.armed else None, sentence or "")
        if robot is not None:
            robot.disable()
        if self.armed:
            self.why_disarmed = sentence
        self.armed = False

    def stop(self) -> None:
        """As hard as it can, motors off; who latches it is the caller."""
        if self.armed:
            self.why_disarmed = "all robots were stopped"
        self.armed = False
        self.sent = self._reached = ZERO
        self.consent.withdraw()
        robot = self.robot
        if robot is not None:
            robot.stop()

    def rest(self) -> None:
        """Zero at once, still armed, until the operator has let go."""
        if self.armed and self.robot is not None:
            self.robot.drive(0.0, 0.0)
        self.sent = self._reached = ZERO
        self.consent.withdraw()

    def new_operator(self) -> None:
        """What the one before asked for, and how it was numbered, counts no more."""
        self.consent = Consent()

    def clear(self) -> None:
        """Forget the robot's fault; an armed one has none."""
        robot = self.robot
        if robot is not None and not self.armed:
            robot.clear()
            self.why_disarmed = None

    # --- every tick ------------------------------------------------------------------------

    def look(self, tick: Tick, *, played: bool) -> str | None:
        """See whether what it takes to move is still there; why not, one sentence.

        Args:
            played: a programme moves it.
        """
        now = tick.now
        lapsed = self.consent.look(now + _NEXT_LOOK_S)
        if self.robot is None:
            self.report = None
            return self._why_not_armed()
        report = self.report = self.robot.report()
        if not self.armed:
            self._blind_since = None
            return self._why_not_armed()
        if report.phase is not RobotPhase.CONNECTED:
            self.disarm(now, "fault", reasons.unconnected(self.role, report))
        elif report.fault is not None:
            self.disarm(now, "fault", report.fault)
        else:
            trouble = self._stand_while_blind(tick)
            if trouble is None and lapsed and (played or self.sent != ZERO):
                self._still(now, "expired", _EXPIRED)
            if self.armed and report.wanted is not None and not self.consent.released:
                # It drives by itself, so nobody can let go of its controls: arm it anew.
                self.disarm(now, None, trouble or _EXPIRED)
                return self.why_disarmed
            if trouble is not None:
                return trouble
            return _EXPIRED if played and not self.consent.present else None
        return self.why_disarmed

    def _stand_while_blind(self, tick: Tick) -> str | None:
        """Why the sight is none to go by; then it stands, and after a second is disarmed."""
        trouble = self._blindness(tick)
        if trouble is None:
            self._blind_since = None
            return None
        if self._blind_since is None:
            self._blind_since = tick.now
            moved = self.sent != ZERO or self.asked != ZERO
            self._still(tick.now, "sight" if moved else None, trouble)
        # Whatever was asked for meanwhile has to be let go of as well.
        self.consent.withdraw()
        if tick.now - self._blind_since >= BLIND_S:
            self.disarm(tick.now, "sight", trouble)
        return trouble

    def _blindness(self, tick: Tick) -> str | None:
        connection = self.connection
        if self.role != "observer" or connection is None:
            return None
        trouble = sight_trouble(tick.sight, tick.now, connection.world)
        if trouble is None and self.verdict is not None and self.verdict.blind:
            return self.verdict.reason or "the guard cannot go by what is seen"
        return trouble

    def drive(self, tick: Tick, played: Velocity | None) -> Sent | None:
        """Send what may be sent at this moment; what went out, None while it is not armed.

        Args:
            played: what a programme asks for, None while none moves this role.
        """
        self.asked = self._asked(played)
        self.hindrance = self._hindrance(tick, played is not None)
        robot, report = self.robot, self.report
        if robot is None or report is None:
            self.verdict = None
            self.sent = self._reached = ZERO
            return None
        wanted = ZERO if self.hindrance is not None else self.asked
        # Also of one that is not armed: the zones are shown, and the guard must know the way.
        verdict = self.verdict = self._ask_guard(report, tick, wanted)
        if not self.armed:
            self.sent = self._reached = ZERO
            return None
        permitted = least(wanted, (verdict.speed_mps, verdict.turn_rate_radps))
        if verdict.blind and self.role == "observer":
            permitted = ZERO
        limits = tick.parameters
        target = ramped(
            self._reached,
            permitted,
            limits.acceleration_mps2,
            limits.turn_acceleration_radps2,
            tick.dt,
        )
        sent = robot.drive(*target)
        stopped = self.sent != ZERO and permitted == ZERO and wanted != ZERO
        if stopped and verdict.reason is not None and not verdict.blind:
            self._tell(tick.now, "guard", verdict.reason)
        self.sent = (sent.speed_mps, sent.turn_rate_radps)
        self._reached = target if reasons.same(target, self.sent) else self.sent
        if self.hindrance is None:
            self.hindrance = reasons.why_less(
                self.role,
                reasons.Way(wanted, permitted, target, self.sent),
                verdict.reason,
                report,
                tick.parameters,
            )
        if isinstance(robot, Explained):
            robot.explain(self.hindrance)
        return sent

    def _asked(self, played: Velocity | None) -> Velocity:
        """By a programme, by a robot that drives by itself while somebody is there, or by hand."""
        if played is not None:
            return played
        if self.report is not None and self.report.wanted is not None:
            return self.report.wanted if self.consent.present else ZERO
        return self.consent.velocity

    def _ask_guard(self, report: RobotReport, tick: Tick, wanted: Velocity) -> Verdict:
        assert self.connection is not None
        try:
            return self._guard.limit(
                self.role,
                wanted,
                (report.speed_mps, report.turn_rate_radps),
                tick.sight if self.role == "observer" else None,
                self.connection.world,
                report.sonars,
                report.radius_m,
                report.width_m,
                report.length_m,
                tick.now,
            )
        except Exception as error:  # noqa: BLE001
            # Whatever is wrong in it, the robots stand, and the loop goes on to say so.
            if self.verdict is None or self.verdict.reason != _GUARD_FAILED:
                _log.exception("the guard failed: %s", type(error).__name__)
            return Verdict("stop", True, 0.0, 0.0, _GUARD_FAILED, 0.0, (), ())

    def _hindrance(self, tick: Tick, played: bool) -> str | None:
        """Why nothing may be driven at all, one sentence; None where something may."""
        if tick.stopped is not None:
            return reasons.stopped_by(tick.stopped)
        if not self.armed:
            return self._why_not_armed()
        trouble = self._blindness(tick)
        if trouble is not None:
            return trouble
        if not played and self.asked != ZERO and not self.consent.released:
            return "the drive was interrupted: let go of the controls once, then drive on"
        return None

    def _why_not_armed(self) -> str:
        return reasons.why_not_armed(self.role, self.connection, self.report, self.why_disarmed)

    # --- telling ---------------------------------------------------------------------------

    def _still(self, now: float, kind: IncidentKind | None, sentence: str) -> None:
        """Zero from here on, until the operator has let go."""
        if kind is not None:
            self._tell(now, kind, sentence)
        self.rest()

    def _tell(self, now: float, kind: IncidentKind, sentence: str) -> None:
        speed = None if self.report is None else self.report.speed_mps
        self._incidents.append(IncidentEvent(self.role, kind, sentence, now, speed))

    def incidents(self) -> list[IncidentEvent]:
        """Those since the last call."""
        told, self._incidents = self._incidents, []
        return told
