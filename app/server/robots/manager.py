"""The server's knowledge of the robots, and its requests to the drive process."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import structlog

from app.contract.commands import Answer
from app.contract.drive import (
    DisarmRobot,
    DriveLostEvent,
    DriveStartedEvent,
    DriveState,
    FromDrive,
    IncidentEvent,
    ResetStop,
    StoppedEvent,
    StopRobots,
    ToDrive,
    WheelSpeedEvent,
)
from app.contract.events import StateEvent
from app.contract.parameters import ParameterValues
from app.contract.robots import (
    DRIVEN_STATES,
    DriveFacts,
    DriveProcess,
    GoalNow,
    RobotNow,
    RobotPortNow,
    RobotsNow,
)
from app.runtime.errors import ProcessUnavailable
from app.runtime.supervisor import ProcessHealth
from app.server.asking import ask_drive
from app.server.background import Background
from app.server.contracts import Drive
from app.server.errors import Conflict, NotAvailable
from app.server.robots.check_manager import CheckManager
from app.server.robots.circumstances import Circumstances
from app.server.robots.connecting import Connecting
from app.server.robots.incidents import IncidentKeeper, Incidents
from app.server.robots.operators import Operators
from app.server.robots.rearming import Rearming
from app.server.robots.wheels import WheelLog, WheelSample
from app.server.source_time import SourceTime
from observer.rig.rig import ROLES, Rig, Role
from observer.robots.contract import RobotPhase
from observer.robots.ports import shown_port

log = structlog.get_logger(__name__)

_NO_PROCESS = "the drive process has not started yet"
_NOTHING_KNOWN = DriveFacts(None, None, None, None, None, dict.fromkeys(ROLES))


class RunKeeper(IncidentKeeper, Protocol):
    """Storage of driving data with a run."""

    def measured(self, sample: WheelSample) -> None: ...

    def heard(self, facts: DriveFacts, source: SourceTime) -> None:
        """Store the robots' states and the goal."""
        ...


class RobotManager:
    """Manager of the robots: follows the drive process, configures it and forwards requests.

    Runs in the event loop's thread and takes no lock of the server, so a stop never waits.

    Attributes:
        operators: who drives. rearming: of a programme's robots. wheels: speeds sent and measured.
        incidents: the newest ones. checks: guided checks of stops.
    """

    def __init__(
        self,
        drive: Drive,
        *,
        rig: Callable[[], Rig],
        guard: Callable[[], ParameterValues],
        changed: Callable[[], None],
        run: Callable[[], RunKeeper | None],
        source_time: SourceTime,
        circumstances: Callable[[], Circumstances],
        check_folder: Path | None,
        clock: Callable[[], float],
    ) -> None:
        """Set up; ``start`` starts the drive process.

        Args:
            rig: returns the current rig. guard: returns the guard's parameters, by dotted name.
            changed: called when ``facts`` change. run: returns the run being recorded.
            source_time: the clock of the open source, on which speeds are timed.
            circumstances: returns the circumstances of a check. check_folder: folder of its
                records, if any.
            clock: the host's monotonic clock.
        """
        self._drive = drive
        self._rig = rig
        self._changed = changed
        self._run = run
        self._source_time = source_time
        self._background = Background()
        self._unsubscribe: Callable[[], None] = lambda: None
        self._connecting = Connecting(drive, guard)
        self._facts = _NOTHING_KNOWN
        self._trouble: str | None = None
        # What the last drive process was driving to when it was lost.
        self._ended_goal: GoalNow | None = None
        self._generation = 0
        self._world: str | None = None
        self.operators = Operators(self.ask, self._background.start)
        self.rearming = Rearming(self._connecting, lambda: self._facts, self.ask, clock)
        self.wheels = WheelLog()
        self.incidents = Incidents(clock, run)
        self.checks = CheckManager(
            check_folder,
            circumstances,
            changed=changed,
            soon=self._background.start,
            clock=clock,
        )

    # --- life cycle ------------------------------------------------------------------------

    def start(self) -> None:
        """Start the drive process in the background; the server also works without it."""
        self._unsubscribe = self._drive.subscribe(self._on_event)
        self._background.start(self._start())
        self._background.start(self._connecting.run())

    async def stop(self) -> None:
        """Stop all robots and the drive process; safe to call twice."""
        await self._background.cancel()
        await self._drive.stop()
        self._unsubscribe()
        await self.checks.close()

    async def _start(self) -> None:
        try:
            await self._drive.start()
        except ProcessUnavailable as error:
            log.error("drive_not_started", reason=str(error))
            self._trouble = f"robots cannot be driven: {error}"
            self._changed()
            return
        # The process may have started before the subscription.
        health = self._drive.health
        if health.alive and health.generation > self._generation:
            self._started(health.generation)

    # --- changes elsewhere -----------------------------------------------------------------

    def source_changed(self, state: StateEvent) -> None:
        """Handle a newly opened source, other robots in the same one, or other ports or models."""
        if state.world != self._world:
            self._ended_goal = None
        self._world = state.world
        self._connecting.want(state, self._rig())
        self._changed()

    def guard_changed(self) -> None:
        """Handle changed parameters."""
        self._connecting.settings_changed()

    def _on_event(self, event: FromDrive) -> None:
        match event:
            case DriveState():
                self._facts = self._with_ended_goal(event.facts)
                self.operators.drive_said(self._facts.robots)
                self.checks.drive_said(self._facts.robots)
                self._connecting.stopped = self._facts.stopped
                if (keeper := self._run()) is not None:
                    keeper.heard(self._facts, self._source_time)
                self._changed()
            case WheelSpeedEvent():
                at, run = self._source_time.at(event.time), self._run()
                sample = self.wheels.take(event, at)
                if sample is not None and run is not None:
                    run.measured(sample)
            case IncidentEvent():
                self.incidents.take(event)
                self._changed()
            case StoppedEvent():
                self.incidents.stopped(event)
                self.checks.stopped(event)
                self._changed()
            case DriveStartedEvent():
                self._started(event.generation)
            case DriveLostEvent():
                self._lost(event)

    def _started(self, generation: int) -> None:
        if generation <= self._generation:
            return
        self._generation = generation
        self._trouble = None
        self._connecting.drive_started(generation)
        self._changed()

    def _lost(self, event: DriveLostEvent) -> None:
        self._trouble = (
            f"{event.reason}; {self._firmware_stops()}. They are reconnected, disarmed, once the "
            "drive process has restarted"
        )
        log.error("drive_lost", reason=event.reason)
        # Robots without a drive process must not be shown as connected.
        self._ended_goal = _ended(self._facts.goal, event.reason)
        self._facts = replace(_NOTHING_KNOWN, stopped=self._facts.stopped, goal=self._ended_goal)
        self.rearming.count_disarming(ROLES)
        self._connecting.drive_lost()
        self.operators.drive_lost(event.reason)
        self._changed()

    def _with_ended_goal(self, facts: DriveFacts) -> DriveFacts:
        """Return the facts with the goal that a lost drive process left, until there is another."""
        if facts.goal is not None:
            self._ended_goal = None
        return facts if self._ended_goal is None else replace(facts, goal=self._ended_goal)

    def _firmware_stops(self) -> str:
        """Return what stops the connected robots without commands, in words."""
        reports = [robot.report for robot in self._facts.robots.values() if robot is not None]
        connected = [each for each in reports if each.phase is RobotPhase.CONNECTED]
        if all(each.watchdog_s for each in connected):
            return "the robots' firmware stops them"
        return (
            "use the robots' own stop switch, as not every robot has reported a watchdog that "
            "stops it"
        )

    # --- state -----------------------------------------------------------------------------

    def facts(self) -> RobotsNow:
        """Return all facts of driving."""
        health, rig = self._drive.health, self._rig()
        return RobotsNow(
            **vars(self._facts),
            process=DriveProcess(
                health.alive,
                health.pid,
                health.restarts,
                self._trouble or (None if health.alive else _NO_PROCESS),
            ),
            world=self._world,
            ports={
                role: RobotPortNow(shown_port(rig.ports[role]), rig.models.get(role))
                if role in rig.ports
                else None
                for role in ROLES
            },
            trouble={role: self._connecting.trouble.get(role) for role in ROLES},
            incidents=self.incidents.newest,
            check=self.checks.facts(),
        )

    @property
    def warnings(self) -> list[str]:
        """Return the present problems, one sentence each."""
        troubles = (self._trouble, *self._connecting.trouble.values(), self._connecting.complaint)
        return [trouble for trouble in troubles if trouble is not None]

    @property
    def connected(self) -> bool:
        """Return whether there is, or should be, any robot."""
        return any(self._facts.robots.values())

    def robot(self, role: Role) -> RobotNow | None:
        """Return a robot's state as in ``facts``; None if there is none."""
        return self._facts.robots.get(role)

    def is_driven(self, role: Role) -> bool:
        """Return whether a robot of this role is armed."""
        robot = self.robot(role)
        return robot is not None and robot.state in DRIVEN_STATES

    def any_driven(self) -> bool:
        """Return whether a robot of any role is armed."""
        return any(map(self.is_driven, ROLES))

    @property
    def loop_late_p99_ms(self) -> float | None:
        """Return the 99th percentile of the drive loop's lateness; None if it reports none."""
        return None if self._facts.loop is None else self._facts.loop.late_p99_ms

    @property
    def health(self) -> ProcessHealth:
        """Return the health of the drive process."""
        return self._drive.health

    # --- requests --------------------------------------------------------------------------

    async def ask(self, command: ToDrive[Answer]) -> Answer:
        """Send a command.

        Raises:
            FieldError, Conflict, NotAvailable: as ``app.server.asking.ask_drive``.
        """
        match command:
            case DisarmRobot():
                self.rearming.count_disarming((command.role,))
            case StopRobots() | ResetStop():
                self.rearming.count_disarming(ROLES)
            case _:
                pass
        return await ask_drive(self._drive, command)

    async def stop_robots(self, by: str) -> None:
        """Stop all robots until ``reset``. Waits only for the drive process.

        Raises:
            NotAvailable: there is no drive process at the moment, or it does not answer; the next
                process receives the stop before it is assigned a robot.
        """
        log.warning("robots_stopped", by=by)
        self._connecting.stop_due = by
        try:
            await self.ask(StopRobots(by))
        except NotAvailable as error:
            # Set again: another stop that was delivered may have cleared the flag for both.
            self._connecting.stop_due = by
            self._connecting.settings_changed()
            raise NotAvailable(
                "use the robots' own stop switch: the stop did not reach the drive process "
                f"({error}). Without commands robots whose watchdog is on stop by themselves; the "
                "new drive process starts in the stopped state"
            ) from error
        self._connecting.stop_due = None

    async def reset(self, by: str) -> None:
        """Release the stop; all robots stay disarmed."""
        log.warning("stop_reset", by=by)
        # A stop requested from here on is a new one and remains latched.
        due, self._connecting.stop_due = self._connecting.stop_due, None
        try:
            await self.ask(ResetStop(by))
        except (Conflict, NotAvailable):
            self._connecting.stop_due = self._connecting.stop_due or due
            raise


def _ended(goal: GoalNow | None, why: str) -> GoalNow | None:
    """Return a goal as it is after the drive process was lost, and with it the robot's place."""
    if goal is None or goal.state != "driving":
        return goal
    return GoalNow(
        state="ended",
        sentence=f"The goal was aborted: {why}.",
        place=None,
        distance_m=None,
        elapsed_s=goal.elapsed_s,
        path=(),
        risk_per_metre=goal.risk_per_metre,
        planned_risk_per_metre=None,
        waits_for=None,
        meets_s=None,
    )
