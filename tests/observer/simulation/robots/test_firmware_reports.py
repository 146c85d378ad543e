"""What the emulated firmware reports: odometry, sensors, and the faults that tests inject."""

from __future__ import annotations

import itertools
import struct

import pytest

from observer.robots.arcos import Command, PacketParser, command
from observer.simulation.robots.emulated import EmulatedRobot
from observer.simulation.robots.floor import Outline, Surroundings

from .talking import (
    ENABLE,
    STOP,
    SYNC,
    TICK_S,
    VEL_200,
    VEL_MINUS_200,
    Talk,
    driving,
    newest,
    opened,
    status,
)


@pytest.mark.parametrize(("model", "mm"), [("p3dx-sh", 1.0), ("p3dx", 0.485), ("amigo", 0.5083)])
def test_positions_wrap_in_15_bits_of_the_models_unit(model: str, mm: float) -> None:
    talk = opened(model)
    talk.say(ENABLE, command(Command.SETA, 2000))
    raw = [
        status(each)["x"] for each in talk.hold(40, command(Command.VEL, 900)) if each[0] == 0x33
    ]
    driven_m = talk.robot.odometry[0]
    assert driven_m > 35
    assert max(raw) <= 0x7FFF
    unwrapped = 0
    for a, b in itertools.pairwise(raw):
        step = b - a
        unwrapped += step + 0x8000 if step < -0x1000 else step
    assert sum(b < a for a, b in itertools.pairwise(raw)) == int(driven_m * 1000 / mm / 0x8000)
    assert (raw[0] + unwrapped) * mm / 1000 == pytest.approx(driven_m, abs=0.1)


def test_seto_zeroes_position_and_heading() -> None:
    talk = driving()
    talk.hold(1, command(Command.RVEL, 60))
    talk.say(STOP)
    talk.wait(2)
    talk.say(command(Command.SETO))
    seen = newest(talk.wait(0.15))
    assert (seen["x"], seen["y"], seen["th"]) == (0, 0, 0)
    talk.hold(2, VEL_200)
    x, y, yaw = talk.robot.odometry
    assert x > 0.2
    assert abs(y) < 1e-6
    assert yaw == 0.0


def test_encoders_are_sent_once_or_with_every_status() -> None:
    talk = driving()
    [reply] = talk.say(command(Command.ENCODER, 1))
    kind, left, right = struct.unpack("<Bii", reply)
    assert (kind, left) == (0x90, right)
    assert left > 0
    talk.say(command(Command.ENCODER, 2))
    kinds = [each[0] for each in talk.hold(1, VEL_200)]
    assert kinds.count(0x90) == kinds.count(0x33)
    talk.say(command(Command.ENCODER, 0))
    assert 0x90 not in [each[0] for each in talk.hold(1, VEL_200)]


def walled() -> Surroundings:
    return Surroundings(outlines=(Outline.of_box(1.2, 0.0, 0.0, 0.4, 2.0),))


def test_it_stalls_at_a_box_and_retries_by_itself() -> None:
    talk = opened(around=walled())
    talk.say(ENABLE)
    heard = talk.hold(6, VEL_200)
    stalls = [status(each)["stall"] & 0x0101 for each in heard]
    assert stalls[0] == 0
    first = stalls.index(0x0101)
    assert newest(heard)["stall"] >> 9 == 0b11111
    # While the motors are relaxed nothing changes; it has tried more than once.
    assert stalls[first : first + 9] == [0x0101] * 9
    assert stalls[first:].count(0x0101) > 12
    assert talk.robot.vehicle.state.x == pytest.approx(1.0 - 0.511 / 2, abs=0.005)
    talk.hold(3, VEL_MINUS_200)
    seen = newest(talk.heard)
    assert (seen["stall"], seen["left"]) == (0, -200)


def test_sonar_sends_only_new_readings_and_all_within_half_a_second() -> None:
    talk = opened(around=walled())
    ranges: dict[int, int] = {}
    for packet in talk.wait(0.5):
        assert 0 < packet[19] < 8
        for k in range(packet[19]):
            index, value = struct.unpack_from("<BH", packet, 20 + 3 * k)
            ranges[index] = value
    assert sorted(ranges) == list(range(16))
    # The box's face is 1 m ahead; sonar 3 sits at 166 mm and looks 10 degrees to the left.
    assert ranges[3] == pytest.approx(1000 - 166, abs=2)
    assert ranges[12] == 5000
    assert newest(talk.heard)["flags"] & 0b110 == 0b110
    talk.say(command(Command.SONAR, 0))
    talk.wait(0.2)
    assert newest(talk.wait(0.2))["sonars"] == 0
    assert newest(talk.heard)["flags"] & 0b110 == 0


def test_bumpers_stall_the_motors_only_if_requested() -> None:
    talk = driving()
    talk.robot.faults.front_bumpers = 0b00100
    seen = newest(talk.hold(1, VEL_200))
    assert seen["stall"] == 0b00100 << 9
    assert seen["left"] == 200
    talk.say(command(Command.BUMPSTALL, 2))
    assert newest(talk.hold(1, VEL_200))["left"] == 200
    talk.say(command(Command.BUMPSTALL, 3))
    assert newest(talk.hold(0.9, VEL_200))["left"] < 10


def test_flags_battery_and_temperature_are_as_set() -> None:
    talk = driving()
    faults = talk.robot.faults
    faults.battery_v, faults.temperature_c, faults.charge_state = 11.34, -5, 2
    faults.state_of_charge, faults.flags = 40, 1 << 7
    seen = newest(talk.wait(0.15))
    assert (seen["battery"], seen["battery_x10"]) == (113, 113)
    assert (seen["celsius"], seen["charge"], seen["percent"]) == (-5, 2, 40)
    assert seen["flags"] & (1 << 7)
    talk.say(command(Command.BATTEST, 105))
    assert newest(talk.wait(0.15))["battery"] == 105
    talk.say(command(Command.BATTEST, 0))
    faults.battery_v, faults.temperature_c = None, None
    seen = newest(talk.wait(0.15))
    assert (seen["battery"], seen["celsius"]) == (0, -127)
    faults.stop_pressed = True
    seen = newest(talk.hold(1, ENABLE, VEL_200))
    assert seen["flags"] & 0b100001 == 0b100000
    assert talk.robot.speed_mps == 0.0
    faults.stop_pressed = False
    assert newest(talk.hold(1, VEL_200))["flags"] & 1 == 0


def test_packet_faults_are_simulated_as_set() -> None:
    talk = opened(around=walled())
    faults = talk.robot.faults
    faults.sonar_overrun = True
    packet = talk.wait(0.15)[0]
    assert packet[19] == 255
    assert len(packet) < 20 + 3 * 255
    faults.sonar_overrun = False
    faults.phantom_bumpers = faults.short_status = True
    assert newest(talk.wait(0.15)) | {"battery": 0, "sonars": 0} == {
        "x": 0, "y": 0, "th": 0, "left": 0, "right": 0, "battery": 0, "stall": 0xFEFE,
        "control": 0, "flags": 0b110, "compass": 0, "sonars": 0,
    }  # fmt: skip
    faults.strange_packets = faults.double_header = faults.false_header = True
    sent = b""
    for _ in range(12):
        talk.now += TICK_S
        sent += talk.robot.tick(talk.now)
    assert sent.count(b"\xfa\xfb\xc8\xfa\xfa\xfb") == 4
    parser = PacketParser()
    found = parser.feed(sent) + parser.abandon()
    assert [each[0] for each in found] == [0x32, 0x98, 0xB0, 0xB8]


def test_sync_can_go_unanswered_or_get_an_invalid_reply() -> None:
    talk = Talk(EmulatedRobot("p3dx-sh"))
    talk.robot.faults.no_sync_reply = True
    assert talk.say(*SYNC) == []
    talk.robot.faults.no_sync_reply = False
    talk.robot.faults.strange_sync_reply = True
    assert talk.say(SYNC[0]) == [b"\xff"]
    talk.robot.faults.strange_sync_reply = False
    assert len(talk.say(*SYNC)) == 3


def test_damaged_commands_are_ignored_and_lose_no_other() -> None:
    talk = opened()
    talk.say(ENABLE)
    count = talk.robot.log.count
    wrong = bytearray(VEL_200)
    wrong[5] ^= 0x40
    cut = VEL_200[:6]
    # A length that promises more bytes than arrive delays the next command, but only once.
    promising = b"\xfa\xfb\xc8" + VEL_MINUS_200
    assert talk.say(bytes(wrong), b"\xfa\xfa\xfb\x00", cut + STOP, promising) == []
    assert [each.number for each in talk.robot.log.since()][count:] == [Command.STOP]
    talk.wait(0.2)
    assert [each.number for each in talk.robot.log.since()][count:] == [
        Command.STOP, Command.VEL,
    ]  # fmt: skip
    assert talk.robot.log.bad_bytes > 10


def test_the_log_gives_the_first_command_to_stand_still() -> None:
    talk = driving()
    log, begin = talk.robot.log, talk.now
    assert log.first_standing(begin) is None
    talk.say(command(Command.RVEL, 10))
    talk.wait(0.1)
    talk.say(command(Command.VEL, 0))
    assert log.first_standing(begin) is None
    talk.wait(0.1)
    talk.say(command(Command.RVEL, 0))
    first = log.first_standing(begin)
    assert first is not None
    assert (first.number, first.argument) == (Command.RVEL, 0)
    assert first.time == pytest.approx(begin + 0.2)
    log.intended = lambda speed, _: speed >= 0
    talk.say(VEL_200, VEL_MINUS_200)
    assert [each.unintended for each in log.since(talk.now)][-2:] == [False, True]
    assert log.unintended == 1
    talk.say(command(Command.ENABLE, 0))
    assert log.since()[-1].is_standstill
