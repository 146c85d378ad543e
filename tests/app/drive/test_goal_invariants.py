"""Whatever happens on the way to a goal: the robot moves only while all conditions hold."""

from __future__ import annotations

import contextlib
import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.contract.drive import (
    COMMAND_FRESH_S,
    PLAN_FRESH_S,
    DisarmRobot,
    ReleaseLease,
    ResetStop,
    SetGuard,
    StartGoal,
    StopGoal,
    StopRobots,
)
from app.runtime.errors import ProcessRefused
from observer.guard.sight import SIGHT_FRESH_S
from observer.navigation.plan import Plan
from observer.robots.contract import REPORT_FRESH_S
from observer.types import Odometry, Status

from .scripted import Bench

ZERO = (0.0, 0.0)


class Drive:
    """A bench on which things happen, and what must be true of it after every tick.

    Attributes:
        attends: whether the operator's page is open. plans: what the engine sends: plans, plans of
            the goal before, plans with this speed, or none.
    """

    def __init__(self) -> None:
        self.bench = Bench()
        self.attends = True
        self.plans: float | str | None = 0.3
        self.consented: tuple[int, str] | None = None
        self.moved = False
        self._present = -math.inf
        self.bench.ready("observer")
        self.bench.stay("observer", 0.1)

    # --- what may happen -------------------------------------------------------------------

    def goal(self) -> None:
        lease = self.bench.leases["observer"]
        told = self.bench.take(StartGoal(lease, 3.0, 0.5, 1e-3))
        assert told.state == "driving"
        going = self.bench.roles.goals.going
        assert going is not None
        self.consented = (going.goal.number, lease)

    def cancel(self) -> None:
        self.consented = None
        self.bench.take(StopGoal())

    def stop(self) -> None:
        self.consented = None
        self.bench.take(StopRobots("Ann"))

    def reset(self) -> None:
        self.bench.take(ResetStop("Ann"))

    def disarm(self) -> None:
        self.consented = None
        self.bench.take(DisarmRobot("observer"))

    def arm(self) -> None:
        self.bench.arm("observer")

    def take_over(self) -> None:
        self.consented = None
        self.bench.lease("observer", "Bob", takeover=True)

    def release(self) -> None:
        self.consented = None
        self.bench.take(ReleaseLease("observer", self.bench.leases["observer"]))

    def lease(self) -> None:
        self.bench.lease("observer")

    def reconnect(self) -> None:
        self.consented = None
        self.bench.connect("observer")

    def loosen(self) -> None:
        self.consented = None
        margin = self.bench.roles.parameters.margin_m
        self.bench.take(SetGuard({"guard.margin_m": margin / 2}))

    def leave(self) -> None:
        self.attends = False

    def return_(self) -> None:
        self.attends = True

    def see(self) -> None:
        self.bench.seeing = {}

    def see_little(self) -> None:
        self.bench.seeing = {"status": Status.DEGRADED, "reasons": ("too dark",)}

    def see_nothing(self) -> None:
        self.bench.seeing = None

    def see_another_world(self) -> None:
        self.bench.seeing = {"world": "simulated:lab:1"}

    def reopen(self) -> None:
        self.consented = None
        self.bench.frame = -1

    def plan(self) -> None:
        self.plans = 0.3

    def plan_nonsense(self) -> None:
        self.plans = math.nan

    def plan_for_another_goal(self) -> None:
        self.plans = "another"

    def plan_nothing(self) -> None:
        self.plans = None

    def fall_silent(self) -> None:
        self.bench.robots["observer"].silent = True

    def report(self) -> None:
        self.bench.robots["observer"].silent = False

    def fault(self) -> None:
        self.bench.robots["observer"].change(fault="a bumper is pressed")

    def lose_odometry(self) -> None:
        self.consented = None
        self.bench.robots["observer"].change(odometry=None)

    def regain_odometry(self) -> None:
        self.bench.robots["observer"].change(odometry=Odometry(0.0, 0.0, 0.0))

    def arrive(self) -> None:
        self.bench.robots["observer"].change(odometry=Odometry(3.0, 0.5, 0.0))

    # --- a while, and what must hold -------------------------------------------------------

    def pass_while(self, ticks: int) -> None:
        for k in range(ticks):
            bench = self.bench
            if self.attends and k % 4 == 0:
                with contextlib.suppress(ProcessRefused):
                    bench.present("observer")
                    self._present = bench.now
            going = bench.roles.goals.going
            if self.plans is not None and going is not None:
                made = Plan(going.goal.number, bench.now, 0.3, 0.0, (), 0.0, "Driving.")
                if self.plans == "another":
                    made = replace(made, goal=going.goal.number - 1)
                elif not isinstance(self.plans, str):
                    made = replace(made, speed_mps=self.plans)
                bench.plan = made
            bench.tick()
            self.check()

    def check(self) -> None:
        bench, driven = self.bench, self.bench.roles.driven["observer"]
        velocities = bench.robots["observer"].velocities
        assert all(math.isfinite(value) for value in driven.sent)
        if driven.sent == ZERO:
            assert not velocities or velocities[-1] == ZERO or not driven.armed
            return
        self.moved = True
        now, going, sight, plan = bench.now, bench.roles.goals.going, bench.sight, bench.plan
        assert going is not None
        assert not going.over
        assert self.consented == (going.goal.number, bench.leases["observer"])
        assert driven.armed
        assert bench.roles.stopped is None
        assert now - self._present < COMMAND_FRESH_S
        assert sight is not None
        assert (sight.status, sight.world) == (Status.OK, "real")
        assert now - sight.received <= SIGHT_FRESH_S
        assert plan is not None
        assert plan.goal == going.goal.number
        assert now - plan.received <= PLAN_FRESH_S
        report = bench.robots["observer"].state
        assert report.received is not None
        assert now - report.received <= REPORT_FRESH_S
        assert report.fault is None
        assert report.odometry is not None


_HAPPENS = [name for name in vars(Drive) if name[0] != "_" and name not in ("pass_while", "check")]
# What must happen before some of it can.
_AFTER = {"lease": ("release",)}
_LONG = st.integers(1, 30)


@settings(max_examples=150)
@given(st.lists(st.tuples(st.sampled_from(_HAPPENS), _LONG), max_size=25))
def test_the_robot_moves_only_under_all_conditions(happens: list[tuple[str, int]]) -> None:
    drive = Drive()
    drive.goal()
    drive.pass_while(30)
    assert drive.moved
    for name, ticks in happens:
        with contextlib.suppress(ProcessRefused):
            getattr(drive, name)()
        drive.pass_while(ticks)


@pytest.mark.parametrize("name", _HAPPENS)
def test_all_of_it_can_happen(name: str) -> None:
    drive = Drive()
    drive.goal()
    drive.pass_while(30)
    for each in (*_AFTER.get(name, ()), name):
        # A refusal fails the test: the property above would try this event in vain.
        getattr(drive, each)()
    drive.pass_while(30)
