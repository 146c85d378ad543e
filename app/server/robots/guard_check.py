"""Guided check of a robot's stops: the user drives as instructed, and the stops are measured.

The check itself moves nothing. It lives in the server, so it outlasts the page that started it.
"""

from __future__ import annotations

from dataclasses import replace

from app.contract.drive import StoppedEvent
from app.contract.robots import CheckedRobot, CheckFacts, CheckOutcome, CheckRecord, RobotNow
from app.contract.values import filled
from app.server.robots.check_steps import MOVING_MPS, PROMISED_MS, Step, steps_of
from app.server.robots.circumstances import Circumstances
from observer.rig.rig import Role

_MARGIN = "guard.margin_m"


class GuardCheck:
    """Guided check of one role. It reads no clock: the caller passes the time, ISO 8601 in UTC.

    Attributes:
        steps: in order. ended_at: None while the check is in progress.
        given_up_by: who aborted it, in words; None if nobody did.
    """

    def __init__(
        self,
        role: Role,
        circumstances: Circumstances,
        *,
        started_at: str,
        started_by: str,
        note: str | None,
    ) -> None:
        self.role: Role = role
        self.circumstances = circumstances
        self.started_at = started_at
        self.started_by = started_by
        self.note = note
        self.steps: list[Step] = steps_of(role)
        self.ended_at: str | None = None
        self.given_up_by: str | None = None
        self._robot = CheckedRobot()
        self._operator: str | None = None

    @property
    def present(self) -> int | None:
        """Return the index of the present step, from 0; None after the end."""
        if self.ended_at is not None:
            return None
        going = (n for n, step in enumerate(self.steps) if step.state in ("waiting", "driving"))
        return next(going, None)

    @property
    def outcome(self) -> CheckOutcome | None:
        """Return the outcome; None while the check is in progress."""
        if self.ended_at is None:
            return None
        if self.given_up_by is not None:
            return "given_up"
        states = {step.state for step in self.steps}
        return "failed" if "failed" in states else "incomplete" if "skipped" in states else "passed"

    def over(self) -> bool:
        """Return whether the check has ended."""
        return self.ended_at is not None

    def robot_said(self, robot: RobotNow | None) -> None:
        """Handle the state of the robot from ``DriveState.facts``."""
        present = self.present
        if present is None:
            return
        speed = None
        if robot is not None:
            report = robot.report
            speed = report.speed_mps
            self._robot = CheckedRobot(robot.name or report.name, report.model, report.watchdog_s)
            self._operator = robot.operator or self._operator
        step = self.steps[present]
        drives = speed is not None and abs(speed) >= MOVING_MPS
        self.steps[present] = replace(step, state="driving" if drives else "waiting")

    def stopped(self, event: StoppedEvent, at: str) -> None:
        """Handle a stop; the first one that fits the present step becomes its result."""
        present = self.present
        if present is None or event.role != self.role:
            return
        margin = self.circumstances.guard.get(_MARGIN)
        self.steps[present] = self.steps[present].with_stop(
            event, at, self._operator, float(margin) if isinstance(margin, (int, float)) else None
        )
        self._end_if_done(at)

    def skip(self, by: str, at: str) -> None:
        """Skip the present step."""
        present = self.present
        if present is not None:
            self.steps[present] = replace(self.steps[present], state="skipped", skipped_by=by)
            self._end_if_done(at)

    def give_up(self, by: str, at: str) -> None:
        """End the check in its present state."""
        if self.ended_at is None:
            self.given_up_by, self.ended_at = by, at

    def _end_if_done(self, at: str) -> None:
        if self.present is None:
            self.ended_at = at

    def facts(self) -> CheckFacts:
        """Return the facts for the page."""
        return filled(CheckFacts, self, promised_ms=PROMISED_MS, steps=list(self.steps))

    def record(self, now: Circumstances) -> CheckRecord:
        """Return the record to store.

        Args:
            now: the circumstances at the end of the check.
        """
        operators = {step.operator: None for step in self.steps if step.operator is not None}
        return CheckRecord(
            **vars(self.facts()),
            **vars(self.circumstances),
            robot=self._robot,
            operators=list(operators),
            changed_meanwhile=now.differences(self.circumstances),
        )
