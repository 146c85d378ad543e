"""What a custom robot sends or fails to send: faults, permits, odometry; on a simulated clock."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import pytest

from observer.robots.contract import SETPOINT_FRESH_S, RobotLimits, RobotPhase
from observer.robots.models import robot_spec
from observer.robots.network.messages import Hello, OdometryMessage, Permit
from observer.robots.network.watch import SILENCE_S, UNHEARD_S, ExternalWatch

HELLO = Hello("Robbie", "driven", None, RobotLimits(0.5, 1.0, 0.4, 2.0), 0.3, 0.4, 0.5)
STEP_S = 0.05


class Scene:
    """A robot that reports every 50 ms, on a clock 1000 s ahead of ours.

    Attributes:
        obeys: its motors follow the permits. speaks, confirms: whether it does so.
        late_s: delay of its messages.
    """

    def __init__(self, model: str | None = None, hello: Hello = HELLO) -> None:
        self.watch = ExternalWatch(None if model is None else robot_spec(model))
        self.now, self.sequence, self.said = 100.0, 0, 0
        self.enabled = False
        self.obeys = self.speaks = self.confirms = True
        self.late_s = 0.0
        self.more: dict[str, Any] = {}
        self.permit = Permit(0, 0, True, None)
        self.confirmed = 0
        self.watch.connected(hello, self.now)

    def odometry(self, **changes: Any) -> OdometryMessage:
        self.said += 1
        message = OdometryMessage(
            self.said, self.now + 1000 - self.late_s, 0.0, 0.0, 0.0, 0.0, 0.0, self.enabled,
            self.confirmed, None, None, None,
        )  # fmt: skip
        return dataclasses.replace(message, **{**self.more, **changes})

    def step(self, drive: tuple[float, float] | None = None) -> Permit:
        self.now += STEP_S
        if drive is not None:
            self.watch.drive(*drive, self.now)
        self.permit = self.watch.permit(self.now)
        self.sequence += 1
        self.watch.permit_sent(self.permit, self.sequence, self.now)
        if self.confirms:
            self.confirmed = self.sequence
        if self.obeys:
            self.enabled = not self.permit.stop
        if self.speaks:
            self.watch.said(self.odometry(), self.now)
        return self.permit

    def steps(self, seconds: float, drive: tuple[float, float] | None = None) -> Permit:
        for _ in range(round(seconds / STEP_S)):
            self.step(drive)
        return self.permit

    @property
    def fault(self) -> str | None:
        return self.watch.report(self.now, 0.25).fault


def driving(**more: Any) -> Scene:
    scene = Scene(**more)
    scene.steps(0.2)
    scene.watch.enable(scene.now)
    assert scene.steps(0.2, (0.3, 0.1)) == Permit(0.3, 0.1, False, None)
    return scene


def test_nothing_is_permitted_until_it_is_armed_and_driven() -> None:
    scene = Scene()
    assert scene.steps(0.2, (0.3, 0.0)) == Permit(0, 0, True, "not armed")
    scene.watch.enable(scene.now)
    assert scene.step((0.3, 0.0)) == Permit(0, 0, False, "its motors are not on yet")
    assert scene.step((0.3, 0.0)) == Permit(0.3, 0, False, None)
    scene.watch.disable()
    assert scene.step((0.3, 0.0)) == Permit(0, 0, True, "not armed")
    scene.watch.enable(scene.now)
    scene.steps(0.2, (0.3, 0.0))
    scene.watch.stop()
    assert scene.step((0.3, 0.0)) == Permit(0, 0, True, "stopped")


def test_a_velocity_that_is_not_repeated_is_no_longer_permitted() -> None:
    scene = driving()
    scene.now += SETPOINT_FRESH_S + 0.001
    assert scene.watch.permit(scene.now) == Permit(0, 0, False, "no speed has been requested")


def test_requested_velocities_are_limited_and_explained() -> None:
    scene = driving()
    assert scene.watch.drive(9, -9, scene.now) == (0.5, -1.0)
    assert scene.watch.explain("it is as fast as may be")
    assert not scene.watch.explain("it is as fast as may be")
    assert scene.watch.permit(scene.now).reason == "it is as fast as may be"
    assert scene.watch.explain(None)
    assert scene.watch.permit(scene.now).reason is None
    for bad in (math.nan, math.inf):
        assert scene.watch.drive(bad, 0.1, scene.now) == (0, 0)
        assert scene.watch.drive(0.1, bad, scene.now) == (0, 0)
    fast = dataclasses.replace(HELLO, limits=RobotLimits(50, 50, 50, 50))
    amigo = driving(model="amigo-sh", hello=fast)
    assert amigo.watch.drive(9, 0, amigo.now) == (robot_spec("amigo-sh").speed_max_mps, 0)


def test_silence_is_a_fault_until_it_ends_and_is_cleared() -> None:
    scene = driving()
    scene.speaks = False
    before = scene.now
    while not scene.step((0.3, 0.1)).stop:
        assert scene.now - before < SILENCE_S + 2 * STEP_S
    assert scene.fault == "no odometry received for 0.5 s"
    scene.watch.clear(scene.now)
    assert scene.fault is not None
    scene.speaks = True
    scene.steps(0.2, (0.3, 0.1))
    assert scene.fault is not None
    scene.watch.enable(scene.now)
    assert scene.step((0.3, 0.1)).stop
    scene.watch.clear(scene.now)
    assert scene.fault is None
    assert scene.step((0.3, 0.1)) == Permit(0, 0, True, "not armed")


def test_unacknowledged_permits_are_a_fault() -> None:
    scene = driving()
    scene.confirms = False
    scene.steps(UNHEARD_S - STEP_S, (0.3, 0.1))
    assert scene.fault is None
    scene.steps(3 * STEP_S, (0.3, 0.1))
    assert scene.fault == "it has not acknowledged a permit for 0.7 s"


def test_delayed_odometry_counts_as_old() -> None:
    """A link that falls behind delivers often enough, but only old data."""
    scene = driving()
    while scene.late_s < 0.6:
        assert scene.late_s > 0.4 or scene.fault is None
        scene.late_s += 0.9 * STEP_S
        scene.step((0.3, 0.1))
    assert scene.fault == "no odometry received for 0.5 s"


@pytest.mark.parametrize("drift", [-1e-3, 1e-3])
def test_clock_drift_does_not_count_as_silence(drift: float) -> None:
    scene = driving()
    for _ in range(round(600 / STEP_S)):
        scene.late_s += drift * STEP_S
        scene.step((0.3, 0.1))
    assert scene.fault is None
    assert abs(scene.late_s) > 0.5


def test_old_and_repeated_odometry_is_ignored_and_counted() -> None:
    scene = driving()
    last = scene.odometry()
    scene.watch.said(last, scene.now)
    heard = scene.watch.report(scene.now, 0.25)
    for replayed in (
        last,
        dataclasses.replace(last, sequence=1, fault="replayed", x=5),
        dataclasses.replace(last, sequence=last.sequence + 1, time=last.time - 1, x=5),
    ):
        scene.watch.said(replayed, scene.now + 0.3)
    told = scene.watch.report(scene.now, 0.25)
    assert (told.fault, told.odometry, told.received) == (None, heard.odometry, heard.received)
    assert told.counters["bad_packets"] == heard.counters["bad_packets"] + 3


@pytest.mark.parametrize("step_s", [5.0, -0.6, -5.0])
def test_a_robot_whose_clock_is_set_stops_if_it_went_back_and_is_heard_again(step_s: float) -> None:
    """As a robot that takes the time of day, which NTP corrects, for a monotonic clock."""
    scene = driving()
    scene.late_s -= step_s
    moved = []
    for _ in range(round(1.0 / STEP_S)):
        moved.append(not scene.step((0.3, 0.1)).stop)
    if step_s > 0:
        assert scene.fault is None
        assert all(moved)
        return
    assert scene.fault == "the clock of its odometry went back; it must be monotonic"
    assert not any(moved[round((SILENCE_S + 2 * STEP_S) / STEP_S) :])
    assert not scene.watch.silent(scene.now)
    scene.watch.clear(scene.now)
    scene.steps(0.2)
    assert scene.fault is None
    assert scene.permit.stop


@pytest.mark.parametrize("back_s", [0.1, 0.35, 0.45, 0.6, 5.0])
def test_odometry_is_current_again_once_a_clock_that_was_set_back_counts(back_s: float) -> None:
    scene = driving()
    scene.late_s += back_s
    scene.steps(SILENCE_S + 3 * STEP_S, (0.3, 0.1))
    assert scene.fault in (None, "the clock of its odometry went back; it must be monotonic")
    assert (scene.fault is None) == (back_s < SILENCE_S)
    scene.watch.clear(scene.now)
    for _ in range(round(25 / STEP_S)):
        scene.step((0.3, 0.1))
        received = scene.watch.report(scene.now, 0.25).received
        assert received is not None
        assert scene.now - received < 0.01
    assert scene.fault is None
    assert scene.watch.report(scene.now, 0.25).counters["odometry_jumps"] == 0


def test_messages_slightly_out_of_order_do_not_make_late_ones_current() -> None:
    """As of a robot whose threads each take the time before they send."""
    scene = driving()
    while scene.late_s < 0.6:
        assert scene.late_s > 0.4 or scene.fault is None
        scene.late_s += 0.9 * STEP_S
        scene.step((0.3, 0.1))
        late = scene.odometry()
        scene.watch.said(dataclasses.replace(late, time=late.time - 0.01), scene.now)
    assert scene.fault == "no odometry received for 0.5 s"


def test_motors_that_switch_off_by_themselves_or_stay_off_are_a_fault() -> None:
    scene = driving()
    scene.obeys = scene.enabled = False
    scene.steps(2 * STEP_S, (0.3, 0.1))
    assert scene.fault == "its motors switched off by themselves"
    scene = Scene()
    scene.steps(0.2)
    scene.obeys = False
    scene.watch.enable(scene.now)
    scene.steps(0.9, (0.3, 0.1))
    assert scene.fault is None
    scene.steps(0.3, (0.3, 0.1))
    assert scene.fault == "its motors did not switch on"


def test_rearming_at_once_is_not_mistaken_for_motors_switching_off() -> None:
    """The robot's answer to the disarming arrives after the arming."""
    scene = driving()
    scene.watch.disable()
    late = scene.odometry(enabled=False)
    scene.watch.enable(scene.now)
    scene.watch.said(late, scene.now)
    assert scene.steps(0.2, (0.3, 0.1)) == Permit(0.3, 0.1, False, None)


def test_a_fault_reported_by_the_robot_lasts_until_it_ends_and_is_cleared() -> None:
    scene = driving()
    scene.more = {"fault": "a bumper is pressed"}
    scene.step((0.3, 0.1))
    assert scene.step((0.3, 0.1)) == Permit(0, 0, True, "a bumper is pressed")
    scene.watch.clear(scene.now)
    assert scene.fault == "a bumper is pressed"
    scene.more = {}
    scene.step()
    scene.watch.clear(scene.now)
    assert scene.fault is None


def test_a_lost_connection_is_a_fault_until_reconnected_and_cleared() -> None:
    scene = driving()
    scene.watch.lost("the robot closed the connection")
    report = scene.watch.report(scene.now, 0.25)
    assert (report.phase, report.fault) == (RobotPhase.WAITING, "the robot closed the connection")
    assert (report.speed_mps, report.motors_enabled, report.received) == (None, None, None)
    scene.watch.clear(scene.now)
    assert scene.fault is not None
    scene.watch.connected(HELLO, scene.now)
    assert scene.step((0.3, 0.1)).stop
    scene.watch.clear(scene.now)
    assert scene.step((0.3, 0.1)) == Permit(0, 0, True, "not armed")
    assert scene.watch.report(scene.now, 0.25).counters["reconnects"] == 1


def test_odometry_accumulates_from_any_origin() -> None:
    scene = Scene()
    for x, y, yaw in ((5, 5, 1.0), (5 + math.cos(1.0), 5 + math.sin(1.0), 1.0 + math.pi / 2)):
        scene.more = {"x": x, "y": y, "yaw": yaw}
        scene.step()
        # Long enough to have driven there.
        scene.now += 2.0
    place = scene.watch.report(scene.now, 0.25).odometry
    assert place is not None
    assert (place.x, place.y, place.yaw) == pytest.approx((1, 0, math.pi / 2))
    # The next connection has another origin, and its heading wraps.
    scene.watch.lost("away")
    scene.watch.connected(HELLO, scene.now)
    for x, yaw in ((-3, math.pi - 0.1), (-4, -math.pi + 0.1)):
        scene.more = {"x": x, "y": 0, "yaw": yaw}
        scene.step()
        # Long enough to have driven there.
        scene.now += 2.0
    place = scene.watch.report(scene.now, 0.25).odometry
    assert place is not None
    turn = math.pi / 2 - (math.pi - 0.1)
    assert (place.x, place.y, place.yaw) == pytest.approx(
        (1 - math.cos(turn), -math.sin(turn), math.pi / 2 + 0.2)
    )


@pytest.mark.parametrize("to", [{"x": -5.0}, {"y": 0.4}, {"yaw": 2.0}])
def test_a_jump_of_its_odometry_does_not_count_as_driven(to: dict[str, float]) -> None:
    """As after a restart of the robot's own odometry: a goal must stay where it was."""
    scene = Scene()
    scene.more = {"x": 0.02}
    scene.steps(0.2)
    before = scene.watch.report(scene.now, 0.25)
    scene.more = to
    scene.steps(0.2)
    after = scene.watch.report(scene.now, 0.25)
    assert after.odometry == before.odometry
    assert after.counters == {
        **before.counters,
        "packets": before.counters["packets"] + 4,
        "odometry_jumps": 1,
    }
    # From there on it counts on.
    scene.more = {**to, "x": to.get("x", 0.0) + 0.02}
    scene.steps(0.05)
    place = scene.watch.report(scene.now, 0.25).odometry
    assert place is not None
    assert before.odometry is not None
    assert math.dist((place.x, place.y), (before.odometry.x, before.odometry.y)) == pytest.approx(
        0.02
    )


def test_only_a_guarded_robot_reports_a_wanted_velocity() -> None:
    for mode, expected in (("driven", None), ("guarded", (0.4, 0.1))):
        scene = Scene(hello=dataclasses.replace(HELLO, mode=mode))  # type: ignore[arg-type]
        scene.more = {"wanted": (0.4, 0.1)}
        scene.step()
        assert scene.watch.report(scene.now, 0.25).wanted == expected
    scene.more = {}
    scene.step()
    assert scene.watch.report(scene.now, 0.25).wanted == (0, 0)
