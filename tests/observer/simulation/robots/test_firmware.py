"""The emulated firmware's bytes, checked against the protocol's own tables; no port, no clock."""

from __future__ import annotations

import itertools
import math
import struct

import pytest

from observer.robots.arcos import Command, PacketParser, command
from observer.simulation.robots.emulated import EmulatedRobot
from observer.simulation.robots.floor import Outline, Surroundings

SYNC = [bytes.fromhex(text) for text in ("fafb03000000", "fafb03010001", "fafb03020002")]
ENABLE = bytes.fromhex("fafb06043b0100053b")
VEL_200 = bytes.fromhex("fafb060b3bc800d33b")
VEL_MINUS_200 = bytes.fromhex("fafb060b1bc800d31b")
E_STOP, STOP = bytes.fromhex("fafb03370037"), bytes.fromhex("fafb031d001d")
TICK_S = 0.01


class Talk:
    """A client that talks to a robot and controls the clock."""

    def __init__(self, robot: EmulatedRobot) -> None:
        self.robot = robot
        self.now = 0.0
        self.heard: list[bytes] = []
        self._parser = PacketParser()

    def say(self, *packets: bytes) -> list[bytes]:
        """Send packets and return the immediate answers."""
        return [one for each in packets for one in self._hear(self.robot.receive(each, self.now))]

    def wait(self, seconds: float) -> list[bytes]:
        """Let time pass and return what arrives meanwhile."""
        heard: list[bytes] = []
        for _ in range(round(seconds / TICK_S)):
            self.now += TICK_S
            heard += self._hear(self.robot.tick(self.now))
        return heard

    def hold(self, seconds: float, *packets: bytes) -> list[bytes]:
        """The same, repeating commands ten times a second."""
        heard: list[bytes] = []
        for _ in range(round(seconds * 10)):
            heard += self.say(*packets) + self.wait(0.1)
        return heard

    def _hear(self, data: bytes) -> list[bytes]:
        found = self._parser.feed(data)
        self.heard += found
        return found


def opened(model: str = "p3dx-sh", **more: object) -> Talk:
    talk = Talk(EmulatedRobot(model, **more))  # type: ignore[arg-type]
    talk.say(*SYNC, command(Command.OPEN))
    return talk


def driving(model: str = "p3dx-sh", **more: object) -> Talk:
    talk = opened(model, **more)
    talk.say(ENABLE)
    talk.hold(2, VEL_200)
    return talk


def status(packet: bytes) -> dict[str, int]:
    """Decode by the table of offsets; fields after the sonar readings only if present."""
    assert packet[0] in (0x32, 0x33)
    names = ("x", "y", "th", "left", "right", "battery", "stall", "control", "flags", "compass")
    values = dict(zip(names, struct.unpack_from("<HHhhhBHhHB", packet, 1), strict=True))
    values["sonars"] = packet[19]
    at = 20 + 3 * packet[19]
    if len(packet) > at + 5:
        further = ("battery_x10", "charge", "turn_rate", "faults", "lateral", "celsius", "percent")
        rest = struct.unpack_from("<HBhHhbB", packet, at + 5)
        values |= dict(zip(further, rest, strict=True))
        assert len(packet) == at + 16
    else:
        assert len(packet) == at + 5
    return values


def newest(packets: list[bytes]) -> dict[str, int]:
    return status([each for each in packets if each[0] in (0x32, 0x33)][-1])


# ---------------------------------------------------------------------- sessions


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


# ---------------------------------------------------------------------- velocities


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


# ---------------------------------------------------------------------- odometry


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


# ---------------------------------------------------------------------- sensing


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


# ---------------------------------------------------------------------- injected faults


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
