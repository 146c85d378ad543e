"""Goals of the observer: one at a time, each for as long as its operator stays present.

While frames arrive in which little can be seen, the robot waits, and goes on by itself once the
view is usable again within the second after which it is disarmed. Anything else that keeps it from
driving ends the goal, missing frames and a reopened source included (starting a run reopens it), so
that recovery from a fault never sets it in motion.
"""

from __future__ import annotations

import math

from app.contract.drive import FARTHEST_GOAL_M, IncidentEvent, StartGoal
from app.drive.consent import ZERO, Velocity
from app.drive.driven_role import DrivenRole
from app.drive.going import Going, place_ahead
from app.runtime.errors import ProcessRefused
from observer.guard.sight import SIGHT_FRESH_S, Sight
from observer.navigation.errand import REACHED_M, Errand, Goal
from observer.navigation.plan import Plan
from observer.types import Status

# Until the operator has been present for a moment after an interruption.
_CONTINUES = "driving was interrupted and continues in a moment"


class Goals:
    """Goals of the observer; see the module. It reads no clock.

    Attributes:
        going: drive to the newest goal, kept after its end; None before the first.
    """

    def __init__(self) -> None:
        self.going: Going | None = None
        self._number = 0
        # Number of the newest frame; each source starts from 0.
        self._frame: int | None = None

    @property
    def driving(self) -> bool:
        """Return whether a goal is being driven to."""
        return self.going is not None and not self.going.over

    def start(self, command: StartGoal, driven: DrivenRole, now: float) -> Going:
        """Begin to drive to another goal, with a robot that is armed and attended.

        Raises:
            ProcessRefused: its position is unknown, it drives autonomously, or the goal is too far
                away or under the robot itself.
        """
        values = (command.ahead_m, command.left_m, command.risk_per_metre)
        if not all(math.isfinite(value) for value in values):
            raise ProcessRefused("a goal's place and risk must be finite numbers", "input")
        distance = math.hypot(command.ahead_m, command.left_m)
        if distance > FARTHEST_GOAL_M:
            raise ProcessRefused(
                f"the goal is {distance:.1f} m away; it must lie within {FARTHEST_GOAL_M:g} m",
                "input",
            )
        if distance <= REACHED_M:
            raise ProcessRefused(
                f"the robot is already there: a goal must be more than {REACHED_M:g} m away",
                "input",
            )
        if not 0 < command.risk_per_metre <= 1:
            raise ProcessRefused("the risk per metre must be above 0 and at most 1", "input")
        report = driven.report
        if report is None or report.odometry is None:
            raise ProcessRefused(
                "the observer's robot reports no odometry, so it cannot find a goal", "state"
            )
        if report.wanted is not None:
            raise ProcessRefused(
                "the observer's robot drives autonomously and accepts no goal from here", "state"
            )
        self._number += 1
        place = place_ahead(report.odometry, command.ahead_m, command.left_m)
        going = self.going = Going(Goal(self._number, *place, command.risk_per_metre), now)
        going.update(report, None, now)
        return going

    def update(
        self,
        driven: DrivenRole,
        sight: Sight | None,
        plan: Plan | None,
        trouble: str | None,
        now: float,
    ) -> IncidentEvent | None:
        """Take over this tick's report and plan; return the incident if the goal ended early.

        Args:
            trouble: why the robot must stand at the moment, one sentence.
        """
        before, self._frame = self._frame, None if sight is None else sight.frame
        reopened = sight is not None and before is not None and sight.frame < before
        going = self.going
        if going is None:
            return None
        going.update(driven.report, plan, now)
        if going.over:
            return None
        if not driven.armed or not driven.consent.present:
            return self.give_up(driven, trouble or "the operator is no longer present", now)
        if reopened:
            return self.give_up(driven, "the camera source was reopened", now)
        waits = _sees_little(sight, now) and driven.silence(now) is None
        if trouble is not None and not waits:
            return self.give_up(driven, trouble, now)
        if driven.report is None or driven.report.odometry is None:
            return self.give_up(driven, "the robot no longer reports odometry", now)
        if going.reached:
            driven.rest()
            going.end("reached", "The goal is reached.", now)
        return None

    def velocity(self, driven: DrivenRole) -> Velocity | None:
        """Return the velocity to ask for; None while there is no goal to drive to."""
        going = self.going
        if going is None or going.over:
            return None
        return going.velocity if driven.consent.released else ZERO

    def sent(self, driven: DrivenRole) -> None:
        """Note why the robot stands in spite of the velocity planned, if it does."""
        if self.going is not None:
            why = driven.hindrance or (None if driven.consent.released else _CONTINUES)
            self.going.hindrance = why if driven.sent == ZERO else None

    def give_up(self, driven: DrivenRole, why: str | None, now: float) -> IncidentEvent | None:
        """End the goal at zero before it is reached; return its incident.

        Args:
            why: one sentence; None where somebody simply requested it.
        """
        going = self.going
        if going is None or going.over:
            return None
        driven.rest()
        if why is None:
            going.end("ended", "The goal was cancelled.", now)
            return None
        going.end("ended", f"The goal was aborted: {why}.", now)
        sentence = f"the drive to the goal was stopped: {why}"
        return IncidentEvent(None, "goal", sentence, now, None)

    def forget(self) -> None:
        """Forget the last goal: it is in the frame of the previous robot's odometry."""
        self.going = None

    def errand(self, driven: DrivenRole) -> Errand | None:
        """Return what a planner needs now; None while there is nothing to plan."""
        if self.going is None or driven.report is None:
            return None
        return self.going.errand(driven.report, driven.sent)


def _sees_little(sight: Sight | None, now: float) -> bool:
    """Return whether frames arrive as they should, but show too little to drive by."""
    fresh = sight is not None and now - sight.received <= SIGHT_FRESH_S
    return fresh and sight is not None and sight.status is not Status.OK
