"""The emulated firmware's sessions and velocities, byte by byte; no port, no clock."""

from __future__ import annotations

import math
import struct

import pytest

from observer.robots.arcos import Command, command
from observer.simulation.robots.emulated import EmulatedRobot

from .talking import (
    E_STOP,
    ENABLE,
    STOP,
    SYNC,
    VEL_200,
    VEL_MINUS_200,
    Talk,
    driving,
    newest,
    opened,
)


def test_the_handshake_echoes_and_then_gives_names() -> None:
    talk = Talk(EmulatedRobot("amigo-sh"))
    assert talk.robot.receive(SYNC[0], 0.0) == SYNC[0]
    assert talk.robot.receive(SYNC[1], 0.0) == SYNC[1]
    [names] = talk.say(SYNC[2])
    assert names[0] == 2
    assert names[1:].split(b"\0")[1:] == [b"Pioneer", b"amigo-sh", b""]
    # Nothing is sent before OPEN, then ten packets a second.
    assert talk.wait(1) == []
    talk.say(command(Command.OPEN))
    assert len(talk.wait(2)) == pytest.approx(20, abs=1)


def test_sync_is_ignored_out_of_order_but_may_be_repeated() -> None:
    talk = Talk(EmulatedRobot("p3dx"))
    assert talk.say(SYNC[2], SYNC[1], command(Command.ENABLE, 1)) == []
    assert [each[0] for each in talk.say(SYNC[0], SYNC[0], SYNC[1], SYNC[1], SYNC[2], SYNC[2])] == [
        0, 0, 1, 1, 2, 2,
    ]  # fmt: skip


def test_an_unclosed_session_continues_until_close() -> None:
    talk = opened()
    talk.robot.cut_off()
    # In a session, the next client's SYNC bytes mean PULSE, OPEN, CLOSE.
    assert talk.say(SYNC[0]) == []
    assert {each[0] for each in talk.wait(0.5)} == {0x32}
    talk.say(command(Command.CLOSE))
    assert talk.wait(0.5) == []
    assert [each[0] for each in talk.say(*SYNC)] == [0, 1, 2]


def test_motors_are_off_at_first_and_ignore_velocities() -> None:
    talk = opened()
    heard = talk.hold(1, VEL_200)
    assert newest(heard)["flags"] & 1 == 0
    assert talk.robot.speed_mps == 0.0
    talk.say(ENABLE)
    assert newest(talk.wait(0.2))["flags"] & 1 == 1
    assert talk.robot.speed_mps == 0.0


@pytest.mark.parametrize("watchdog_s", [2.0, 0.7])
def test_config_reports_limits_and_watchdog(watchdog_s: float) -> None:
    [reply] = opened("p3dx-sh", watchdog_s=watchdog_s).say(command(Command.CONFIG))
    words = reply[1:].split(b"\0", 3)
    assert (reply[0], words[:2]) == (0x20, [b"Pioneer", b"p3dx-sh"])
    numbers, rest = words[3][:11], words[3][11:]
    assert struct.unpack("<BHHHHH", numbers)[1:3] == (500, 2200)
    name, rest = rest.split(b"\0", 1)
    assert b"Pioneer P3-DX" in name
    cycle, baud, _, _, front, rear, low, _, watchdog = struct.unpack_from("<BBBHHBHHH", rest)
    assert (cycle, baud, front, rear, low) == (100, 0, 1, 1, 110)
    assert watchdog == round(watchdog_s * 1000)
    # stallVal, stallCount, joyVel, joyRVel, then what SETRV and SETV change.
    assert struct.unpack_from("<BHHHHHH", rest, 14)[5:] == (500, 2200)
    assert rest[-6:-4] == bytes([5, 5])


def test_velocity_follows_the_acceleration_and_is_in_the_status() -> None:
    talk = opened()
    talk.say(ENABLE, command(Command.SETA, 500), command(Command.SETA, -250))
    talk.hold(0.3, VEL_200)
    # 0.15 m/s by the ramp, less the lag of inertia.
    assert 0.08 < talk.robot.speed_mps < 0.15
    heard = talk.hold(1.5, VEL_200)
    seen = newest(heard)
    assert (seen["left"], seen["right"]) == (200, 200)
    assert heard[-1][0] == 0x33
    driven_m = talk.robot.odometry[0]
    assert seen["x"] == pytest.approx(driven_m * 1000, abs=5)
    talk.say(STOP)
    talk.wait(0.4)
    assert 0.09 < talk.robot.speed_mps < 0.15
    talk.wait(1)
    assert talk.robot.speed_mps == 0.0
    assert talk.heard[-1][0] == 0x32


def test_it_drives_backwards_and_e_stop_brakes_hard() -> None:
    talk = opened()
    talk.say(ENABLE)
    talk.hold(2, VEL_MINUS_200)
    seen = newest(talk.heard)
    assert (seen["left"], seen["right"]) == (-200, -200)
    assert seen["x"] > 0x7000
    talk.say(E_STOP, command(Command.VEL, 0))
    talk.wait(0.3)
    assert talk.robot.speed_mps < 0.01
    # E_STOP does not latch.
    talk.hold(2, VEL_200)
    assert talk.robot.speed_mps == pytest.approx(0.2, abs=0.005)


@pytest.mark.parametrize(("model", "factor"), [("p3dx-sh", 0.0056), ("amigo-sh", 0.011)])
def test_a_left_turn_is_positive_and_wheels_differ_by_the_models_factor(
    model: str, factor: float
) -> None:
    talk = opened(model)
    talk.say(ENABLE)
    heard = talk.hold(1, command(Command.RVEL, 30))
    seen = newest(heard)
    assert seen["turn_rate"] == pytest.approx(300, abs=5)
    assert (seen["right"] - seen["left"]) / 2 * factor == pytest.approx(math.radians(30), rel=0.03)
    assert seen["th"] * 0.001534 == pytest.approx(talk.robot.vehicle.state.heading, abs=0.06)
    assert talk.robot.vehicle.state.heading > 0.3


def test_wheel_velocities_and_forward_velocity_replace_each_other() -> None:
    talk = opened()
    talk.say(ENABLE, command(Command.SETA, 1000), command(Command.SETRA, 300))
    # Left 5 and right 10, times 20 mm/s.
    seen = newest(talk.hold(1.5, command(Command.VEL2, 5 << 8 | 10)))
    assert (seen["left"], seen["right"]) == pytest.approx((100, 200), abs=2)
    # -5 and -10: as an int16, and as the same bits unsigned.
    bits = (-5 & 0xFF) << 8 | (-10 & 0xFF)
    for argument in (bits, bits - 0x10000):
        seen = newest(talk.hold(2, command(Command.VEL2, argument)))
        assert (seen["left"], seen["right"]) == pytest.approx((-100, -200), abs=2)
    seen = newest(talk.hold(2, VEL_200))
    assert (seen["left"], seen["right"]) == (200, 200)


def test_velocity_is_limited_by_setv_and_by_the_model() -> None:
    talk = opened("amigo-sh")
    talk.say(ENABLE, command(Command.SETA, 2000))
    talk.hold(3, command(Command.VEL, 5000))
    assert talk.robot.speed_mps == pytest.approx(1.0, abs=0.01)
    assert talk.robot.log.unintended == 30
    talk.say(command(Command.SETV, 150))
    talk.hold(3, command(Command.VEL, 800))
    assert talk.robot.speed_mps == pytest.approx(0.15, abs=0.01)
    assert talk.robot.log.unintended == 30


def test_the_watchdog_stops_it_until_any_command_resumes_the_velocity() -> None:
    talk = driving()
    talk.wait(1.9)
    assert talk.robot.speed_mps == pytest.approx(0.2, abs=0.005)
    talk.wait(1.5)
    assert talk.robot.timed_out
    assert talk.robot.speed_mps == 0.0
    assert newest(talk.heard)["flags"] & 1 == 1
    talk.say(SYNC[0])
    talk.wait(1.2)
    assert talk.robot.speed_mps == pytest.approx(0.2, abs=0.01)
    # After STOP it stays where it is.
    talk.wait(3)
    talk.say(STOP, SYNC[0])
    talk.wait(1.5)
    assert talk.robot.speed_mps == 0.0


def test_switching_the_motors_off_discards_the_velocity() -> None:
    talk = driving()
    talk.say(command(Command.ENABLE, 0))
    talk.wait(1)
    assert talk.robot.speed_mps == 0.0
    talk.say(ENABLE)
    talk.hold(1, SYNC[0])
    assert talk.robot.speed_mps == 0.0


def test_motors_that_switch_off_by_themselves_show_in_the_flags() -> None:
    talk = driving()
    talk.robot.motors_off()
    heard = talk.hold(1, VEL_200)
    assert newest(heard)["flags"] & 1 == 0
    assert talk.robot.speed_mps == 0.0


def test_move_and_heading_are_reached_and_held() -> None:
    talk = opened()
    talk.say(ENABLE, command(Command.MOVE, -300))
    talk.hold(5, SYNC[0])
    assert talk.robot.odometry[0] == pytest.approx(-0.3, abs=0.03)
    talk.say(command(Command.HEAD, 170))
    talk.hold(4, SYNC[0])
    talk.say(command(Command.DHEAD, 40))
    talk.hold(3, SYNC[0])
    told = newest(talk.heard)["th"] * 0.001534
    assert math.degrees(told) == pytest.approx(-150, abs=3)
    assert talk.robot.speed_mps == 0.0
