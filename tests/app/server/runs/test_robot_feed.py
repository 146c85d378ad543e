"""What a run keeps about the robots and the observer's goal."""

from __future__ import annotations

from app.contract.robots import DriveFacts, GoalNow, RobotNow, Velocity
from app.server.runs.recording import RobotFeed
from observer.robots.contract import RobotPhase, RobotReport

STILL = Velocity(0.0, 0.0)


class Lab:
    """A feed that receives a robot's report ten times a second."""

    def __init__(self) -> None:
        self.feed = RobotFeed()
        self.now = 0.0

    def hear(self, state: str | None) -> str | None:
        """Report the goal's state and return the one kept with the robot's row."""
        self.now += 0.1
        report = RobotReport(RobotPhase.CONNECTED, received=self.now)
        robot = RobotNow(
            "/dev/robot", None, "real", "armed", "Ann", True, None, STILL, STILL, None, report
        )
        goal = None if state is None else _goal(state)
        self.feed.heard(
            DriveFacts(None, None, None, None, goal, {"observer": robot, "obstacle": None}), None
        )
        kept = self.feed.take()
        assert kept is not None
        (row,) = kept.rows
        assert row.facts["state"] == "armed"
        return None if row.facts["goal"] is None else str(row.facts["goal"]["state"])


def _goal(state: str) -> GoalNow:
    return GoalNow(state, "", (1.0, 0.0), 1.0, 0.5, [(0.1, 0.0)], 1e-3, 0.0, None, None)  # type: ignore[arg-type]


def test_a_goal_is_recorded_until_its_end_only() -> None:
    lab = Lab()
    states = [None, "driving", "driving", "reached", "reached", "driving", "ended", "ended", None]
    kept = [None, "driving", "driving", "reached", None, "driving", "ended", None, None]
    assert [lab.hear(state) for state in states] == kept


def test_the_end_of_an_earlier_goal_is_not_recorded() -> None:
    lab = Lab()
    assert lab.hear("reached") is None
    assert lab.hear("driving") == "driving"
