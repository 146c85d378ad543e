"""State of one role: its robot, whether it is armed, and its command at this moment.

Nothing here waits or reads a clock; the loop passes the time. The states::

    no robot --ConnectRobot--> connecting --> disarmed --ArmRobot--> armed <--> moving
                               waiting, refused   ^------- whatever disarms ------'

"""

from __future__ import annotations

from app.contract.drive import IncidentEvent, IncidentKind
from app.contract.robots import RobotState
from app.drive import reasons
from app.drive.connection import Connection, Tick
from app.drive.consent import ZERO, Consent, Velocity
from app.drive.guarding import AskedGuard
from app.drive.ramp import least, ramped
from app.runtime.errors import ProcessRefused
from observer.guard.guard import Guard, Verdict
from observer.rig.rig import Role
from observer.robots.contract import Explained, Robot, RobotPhase, RobotReport, Sent

# A command or report that would expire before the next tick is already invalid at this one: no
# robot moves on an expired one, and a late tick has this much margin.
_NEXT_LOOK_S = 0.02
# A robot is disarmed after this long without sight or reports.
BLIND_S = 1.0
_EXPIRED = "no command from the operator arrived in time"
# What the operator must do before the robot drives again.
RELEASE_FIRST = "release the controls once, then continue"
_INTERRUPTED = f"driving was interrupted: {RELEASE_FIRST}"


class DrivenRole:
    """Driver of one role; see the module.

    Attributes:
        connection: None while no robot was requested.
        consent: of the holder of its lease.
        armed: its motors may be on.
        asked: requested velocity, whether or not it may be driven.
        sent: velocity really sent last.
        hindrance: the reason why it does not drive as requested, one sentence.
        why_disarmed: the reason for the last disarming.
        report: the robot's last report.
    """

    def __init__(self, role: Role, guard: Guard) -> None:
        self.role: Role = role
        self._guard = AskedGuard(role, guard)
        self.connection: Connection | None = None
        self.consent = Consent()
        self.armed = False
        self.asked = ZERO
        self.sent = ZERO
        # Starting value of the ramp: ports round the sent velocity, and many steps are smaller than
        # that.
        self._reached = ZERO
        self.hindrance: str | None = None
        self.why_disarmed: str | None = None
        self.report: RobotReport | None = None
        self._unsure_since: float | None = None
        # Why the operator has to let go.
        self._interruption = _INTERRUPTED
        self._incidents: list[IncidentEvent] = []

    # --- connection ------------------------------------------------------------------------

    @property
    def robot(self) -> Robot | None:
        """Return the driven robot, once it is opened."""
        return None if self.connection is None else self.connection.robot

    @property
    def verdict(self) -> Verdict | None:
        """Return the guard's last verdict; None without a robot."""
        return self._guard.verdict

    @property
    def state(self) -> RobotState | None:
        """Return the state in one word; None without a robot."""
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
        """Replace the robot, or drop it; the caller closes the previous one, which is at zero."""
        before = self.robot
        if before is not None:
            before.disable()
        self.connection = connection
        self.armed = False
        self.asked = self.sent = self._reached = ZERO
        self.consent.withdraw()
        self.hindrance = self.why_disarmed = self.report = None
        self._unsure_since = None
        self._guard.forget()
        return before

    def let_go(self) -> Robot | None:
        """Give up the robot without sending it anything more; the caller closes it."""
        robot, self.connection = self.robot, None
        self.armed = False
        self.sent = self._reached = ZERO
        return robot

    # --- arming ----------------------------------------------------------------------------

    def arm(self, tick: Tick) -> None:
        """Switch the motors on, at zero.

        Raises:
            ProcessRefused: the missing condition, one sentence.
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
        self._unsure_since = None
        self.consent.arm()

    def disarm(
        self, now: float, kind: IncidentKind | None = None, sentence: str | None = None
    ) -> None:
        """Send zero and switch the motors off.

        Args:
            kind, sentence: of the resulting incident; None where somebody simply requested it.
        """
        robot = self.robot
        self._still(now, kind if self.armed else None, sentence or "")
        if robot is not None:
            robot.disable()
        if self.armed:
            self.why_disarmed = sentence
        self.armed = False

    def stop(self) -> None:
        """Stop as hard as possible, motors off; the caller latches the stop."""
        if self.armed:
            self.why_disarmed = "all robots were stopped"
        self.armed = False
        self.sent = self._reached = ZERO
        self.consent.withdraw()
        robot = self.robot
        if robot is not None:
            robot.stop()

    def rest(self, why: str = _INTERRUPTED) -> None:
        """Send zero at once and stay armed; drive again only once the operator has let go.

        Args:
            why: one sentence, shown until then.
        """
        self._interruption = why
        if self.armed and self.robot is not None:
            self.robot.drive(0.0, 0.0)
        self.sent = self._reached = ZERO
        self.consent.withdraw()

    def ask_again(self, now: float, why: str) -> None:
        """Let an armed robot that was asked to move rest, as what was consented to has changed.

        Nobody can let go of a robot that drives autonomously: it must be armed again.

        Args:
            why: one sentence.
        """
        moves = any(each != ZERO for each in (self.consent.velocity, self.asked, self.sent))
        if self.armed and self.report is not None and self.report.wanted is not None:
            self.disarm(now, None, why)
        elif self.armed and moves:
            self.rest(f"{why}: {RELEASE_FIRST}")

    def new_operator(self) -> None:
        """Forget the previous operator's requests and their numbering."""
        self.consent = Consent()

    def clear(self) -> None:
        """Clear the robot's fault; an armed robot has none."""
        robot = self.robot
        if robot is not None and not self.armed:
            robot.clear()
            self.why_disarmed = None

    # --- every tick ------------------------------------------------------------------------

    def enforce_conditions(self, tick: Tick, *, played: bool) -> str | None:
        """Stop or disarm it unless all conditions for moving hold; return the reason, one sentence.

        Args:
            played: a programme moves it.
        """
        now = tick.now
        lapsed = self.consent.expire(now + _NEXT_LOOK_S)
        if self.consent.released:
            self._interruption = _INTERRUPTED
        if self.robot is None:
            self.report = None
            return self._why_not_armed()
        report = self.report = self.robot.report()
        if not self.armed:
            self._unsure_since = None
            return self._why_not_armed()
        if report.phase is not RobotPhase.CONNECTED:
            self.disarm(now, "fault", reasons.unconnected(self.role, report))
        elif report.fault is not None:
            self.disarm(now, "fault", report.fault)
        else:
            trouble = self._stand_while_unsure(tick)
            if trouble is None and lapsed and (played or self.sent != ZERO):
                self._still(now, "expired", _EXPIRED)
            if self.armed and report.wanted is not None and not self.consent.released:
                # It drives autonomously, so nobody can let go of its controls: it must be armed
                # anew.
                self.disarm(now, None, trouble or _EXPIRED)
                return self.why_disarmed
            if trouble is not None:
                return trouble
            return _EXPIRED if played and not self.consent.present else None
        return self.why_disarmed

    def _stand_while_unsure(self, tick: Tick) -> str | None:
        """Return why its reports or the sight are unusable.

        Hold zero meanwhile, and disarm after a second.
        """
        silence = self.silence(tick.now)
        trouble = silence or self._blindness(tick)
        if trouble is None:
            self._unsure_since = None
            return None
        kind: IncidentKind = "sight" if silence is None else "fault"
        if self._unsure_since is None:
            self._unsure_since = tick.now
            moved = self.sent != ZERO or self.asked != ZERO
            self._still(tick.now, kind if moved else None, trouble)
        # Requests made meanwhile must be let go of as well.
        self.consent.withdraw()
        if tick.now - self._unsure_since >= BLIND_S:
            self.disarm(tick.now, kind, trouble)
        return trouble

    def silence(self, now: float) -> str | None:
        """Return why the connected robot's report is too old to move by, one sentence."""
        report = self.report
        if report is None or report.phase is not RobotPhase.CONNECTED:
            return None
        return reasons.silence(self.role, report, now + _NEXT_LOOK_S)

    def _blindness(self, tick: Tick) -> str | None:
        connection = self.connection
        if self.role != "observer" or connection is None:
            return None
        return self._guard.blindness(tick, connection.world)

    def drive(self, tick: Tick, played: Velocity | None) -> Sent | None:
        """Send the velocity permitted at this moment and return it; None while it is not armed.

        Args:
            played: velocity requested by a programme; None while none moves this role.
        """
        self.asked = self._asked(played)
        self.hindrance = self._hindrance(tick, played is not None)
        connection, robot, report = self.connection, self.robot, self.report
        if connection is None or robot is None or report is None:
            self._guard.withdraw()
            self.sent = self._reached = ZERO
            return None
        wanted = ZERO if self.hindrance is not None else self.asked
        # Also for an unarmed robot: the zones are shown, and the guard must know the path.
        verdict = self._guard.ask(report, tick, connection.world, wanted)
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
                wanted=wanted,
                permitted=permitted,
                target=target,
                sent=self.sent,
                guard=verdict.reason,
                report=report,
                parameters=tick.parameters,
            )
        if isinstance(robot, Explained):
            robot.explain(self.hindrance)
        return sent

    def _asked(self, played: Velocity | None) -> Velocity:
        """Return the velocity asked by a programme, an attended autonomous robot, or by hand."""
        if played is not None:
            return played
        if self.report is not None and self.report.wanted is not None:
            return self.report.wanted if self.consent.present else ZERO
        return self.consent.velocity

    def _hindrance(self, tick: Tick, played: bool) -> str | None:
        """Return why nothing may be driven at all, one sentence; None where something may."""
        if tick.stopped is not None:
            return reasons.stopped_by(tick.stopped)
        if not self.armed:
            return self._why_not_armed()
        trouble = self.silence(tick.now) or self._blindness(tick)
        if trouble is not None:
            return trouble
        if not played and self.asked != ZERO and not self.consent.released:
            return self._interruption
        return None

    def _why_not_armed(self) -> str:
        return reasons.why_not_armed(self.role, self.connection, self.report, self.why_disarmed)

    # --- telling ---------------------------------------------------------------------------

    def _still(self, now: float, kind: IncidentKind | None, sentence: str) -> None:
        """Hold zero from here on, until the operator has let go."""
        if kind is not None:
            self._tell(now, kind, sentence)
        self.rest()

    def _tell(self, now: float, kind: IncidentKind, sentence: str) -> None:
        speed = None if self.report is None else self.report.speed_mps
        self._incidents.append(IncidentEvent(self.role, kind, sentence, now, speed))

    def incidents(self) -> list[IncidentEvent]:
        """Return the incidents since the last call."""
        incidents, self._incidents = self._incidents, []
        return incidents
