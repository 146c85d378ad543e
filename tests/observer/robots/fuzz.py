"""Damage streams of packets and count what is received as something else.

python tests/observer/robots/fuzz.py [PACKETS] [--noise 0.01]
"""

from __future__ import annotations

import argparse
import dataclasses
import random
import struct
import sys
import time
from collections.abc import Callable

from observer.robots.arcos import Command, PacketParser, command, decode_command, packet
from observer.robots.models import robot_spec
from observer.robots.sip import decode_status, is_status
from observer.simulation.robots.emulated import EmulatedRobot
from observer.simulation.robots.firmware import WATCHDOG_S

_CHUNK = 200
_VELOCITIES = (Command.VEL, Command.RVEL, Command.VEL2, Command.ENABLE)
MOTIONS = (*_VELOCITIES[:3], Command.MOVE, Command.HEAD, Command.DHEAD)
OPENING = b"".join(map(command, (0, 1, 2, Command.OPEN)))
STARTING = command(Command.ENABLE, 1) + command(Command.VEL, 200)
_TICK_S = 0.02
_COMMANDS_A_SESSION = 10


@dataclasses.dataclass
class Tally:
    """The result of fuzzing packets.

    Attributes:
        sent: packets. whole: received as sent. lost: never received. altered: received with a
            valid checksum but unlike every packet sent: what a 16-bit checksum lets through.
        misread: altered ones that are taken for a status packet, or for a velocity or ENABLE
            other than was sent. raised: any exception other than a refusal.
        seconds: duration.
    """

    sent: int = 0
    whole: int = 0
    lost: int = 0
    altered: int = 0
    misread: int = 0
    raised: int = 0
    seconds: float = 0.0

    def __str__(self) -> str:
        return ", ".join(f"{name} {value:.6g}" for name, value in vars(self).items())


@dataclasses.dataclass
class RobotTally:
    """The result of fuzzing a robot.

    Attributes:
        sent: commands. obeyed: those the robot obeyed. unsent: obeyed, but not in the bytes at all.
        unasked: sessions in which the wheels turned without a command to. deaf: sessions in which
            a valid command after the noise was not obeyed. restless: sessions in which noise
            alone kept the robot going for longer than its watchdog. raised: any exception.
        seconds: duration.
    """

    sent: int = 0
    obeyed: int = 0
    unsent: int = 0
    unasked: int = 0
    deaf: int = 0
    restless: int = 0
    raised: int = 0
    seconds: float = 0.0

    def __str__(self) -> str:
        return ", ".join(f"{name} {value:.6g}" for name, value in vars(self).items())


def some_status(rng: random.Random) -> bytes:
    """Return a status packet as a moving robot sends it."""
    sonar = [(rng.randrange(16), rng.randrange(100, 5001)) for _ in range(rng.randrange(9))]
    tail = bytes(5) + struct.pack("<HBhHhbB", 126, 0, rng.randrange(-300, 300), 0, 0, 30, 80)
    return (
        struct.pack(
            "<BHHhhhBHhHBB",
            rng.choice((0x32, 0x33)),
            rng.randrange(0x8000),
            rng.randrange(0x8000),
            rng.randrange(-2048, 2048),
            rng.randrange(-500, 501),
            rng.randrange(-500, 501),
            rng.randrange(110, 135),
            rng.choice((0, 1, 0x100, 0xFEFE)),
            0,
            rng.randrange(2),
            0,
            len(sonar),
        )
        + b"".join(struct.pack("<BH", *each) for each in sonar)
        + tail[: rng.choice((5, 7, 16))]
    )


def some_command(rng: random.Random) -> bytes:
    """Return a command such as a driver sends, mostly velocities."""
    number = rng.choice((Command.VEL, Command.RVEL, Command.VEL, Command.RVEL, Command.STOP))
    argument = None if number is Command.STOP else rng.randrange(-500, 501)
    return command(number, argument)[3:-2]


def any_command(rng: random.Random) -> bytes:
    """Return any number with any argument, few of which a driver sends."""
    number = rng.choice((*(each for each in Command if each is not Command.CLOSE), *range(256)))
    argument: int | bytes | None = rng.randrange(-32768, 65536)
    match rng.randrange(4):
        case 0:
            argument = None
        case 1:
            argument = rng.randbytes(rng.randrange(201))
    return command(number, argument)[3:-2]


def still_command(rng: random.Random) -> bytes:
    """Return any command except those that may turn the wheels."""
    while (made := any_command(rng))[0] in MOTIONS:
        pass
    return made


def damaged(stream: bytes, noise: float, rng: random.Random) -> bytes:
    """Replace, drop, duplicate and insert bytes, each byte with probability ``noise``."""
    made = bytearray()
    for each in stream:
        if rng.random() >= noise:
            made.append(each)
            continue
        kind = rng.randrange(10)
        if kind < 6:
            made.append(rng.randrange(256))
        elif kind == 6:
            made += bytes((each, each))
        elif kind == 7:
            made += rng.randbytes(rng.randrange(1, 8)) + bytes((each,))
        elif kind == 8:
            made += b"\xfa" + bytes((each,))
        # Else it is dropped.
    return bytes(made)


def read_status(payload: bytes) -> bool:
    """Return whether a driver would accept it as a status packet."""
    if not is_status(payload):
        return False
    try:
        decode_status(payload, robot_spec("p3dx-sh"), 5, 5)
    except ValueError:
        return False
    return True


def read_velocity(payload: bytes) -> bool:
    """Return whether a robot would accept it as a velocity or as switching its motors."""
    try:
        return decode_command(payload).number in _VELOCITIES
    except ValueError:
        return False


def fuzz(
    count: int,
    make: Callable[[random.Random], bytes],
    reads: Callable[[bytes], bool],
    noise: float = 0.01,
    seed: int = 0,
) -> Tally:
    """Send ``count`` packets through noise in arbitrary pieces, and compare what arrives."""
    rng, tally, parser = random.Random(seed), Tally(), PacketParser()
    began = time.perf_counter()
    while tally.sent < count:
        payloads = [make(rng) for _ in range(min(_CHUNK, count - tally.sent))]
        tally.sent += len(payloads)
        stream = damaged(b"".join(map(packet, payloads)), noise, rng)
        arrived: list[bytes] = []
        at = 0
        try:
            while at < len(stream):
                size = rng.randrange(1, 400)
                arrived += parser.feed(stream[at : at + size])
                at += size
            arrived += parser.abandon()
            unsent = [each for each in arrived if each not in set(payloads)]
            tally.whole += len(arrived) - len(unsent)
            tally.altered += len(unsent)
            tally.misread += sum(map(reads, unsent))
            for each in arrived:
                reads(each)
        except Exception as error:  # noqa: BLE001 - what is looked for
            tally.raised += 1
            sys.stderr.write(f"{error!r}\n")
    tally.lost = max(0, tally.sent - tally.whole)
    tally.seconds = time.perf_counter() - began
    return tally


def packets_in(stream: bytes) -> list[bytes]:
    """Return the payload of every span that is a packet, at any offset and in any parser state."""
    found = []
    at = -1
    while (at := stream.find(b"\xfa\xfb", at + 1)) >= 0:
        body = stream[at + 3 : at + 3 + (stream[at + 2] if at + 2 < len(stream) else 0)]
        if at + 2 < len(stream) and len(body) == stream[at + 2] >= 3:
            data, check = body[:-2], int.from_bytes(body[-2:], "big")
            total = sum(value << 8 for value in data[: len(data) & ~1 : 2])
            total += sum(data[1 : len(data) & ~1 : 2])
            if (total & 0xFFFF) ^ (data[-1] if len(data) % 2 else 0) == check:
                found.append(data)
    return found


def numbers_in(stream: bytes) -> set[int]:
    """Return the numbers of all commands that any parser could find in the stream."""
    return {payload[0] for payload in packets_in(stream)}


def fuzz_robot(
    sessions: int,
    make: Callable[[random.Random], bytes],
    noise: float = 0.01,
    seed: int = 0,
) -> RobotTally:
    """Open sessions with an emulated robot, and send it commands through noise in pieces.

    Each begins with the motors on and ends with noise alone, while the robot is under way.
    """
    rng, tally = random.Random(seed), RobotTally()
    began = time.perf_counter()
    for _ in range(sessions):
        try:
            _fuzz_session(rng, make, noise, tally)
        except Exception as error:  # noqa: BLE001 - what is looked for
            tally.raised += 1
            sys.stderr.write(f"{error!r}\n")
    tally.seconds = time.perf_counter() - began
    return tally


class _Session:
    """A robot that receives bytes while time passes."""

    def __init__(self) -> None:
        self.robot = EmulatedRobot("p3dx-sh")
        self.now = 0.0

    def say(self, data: bytes) -> None:
        self.robot.receive(data, self.now)

    def wait(self, seconds: float) -> None:
        for _ in range(max(1, round(seconds / _TICK_S))):
            self.now += _TICK_S
            self.robot.tick(self.now)

    def trickle(self, stream: bytes, longest_s: float, rng: random.Random) -> None:
        """Send the stream in pieces, with pauses between them."""
        at = 0
        while at < len(stream):
            size = rng.randrange(1, 60)
            self.say(stream[at : at + size])
            at += size
            self.wait(rng.choice((0.0, 0.0, 0.02, longest_s)))

    def resume(self) -> None:
        """Send what a driver sends after trouble on the line."""
        self.wait(0.2)
        self.say((b"" if self.robot.is_open else OPENING) + STARTING)


def _fuzz_session(
    rng: random.Random, make: Callable[[random.Random], bytes], noise: float, tally: RobotTally
) -> None:
    session = _Session()
    robot, log = session.robot, session.robot.log
    session.say(OPENING + command(Command.ENABLE, 1))
    before = log.count
    sent = [make(rng) for _ in range(_COMMANDS_A_SESSION)]
    tally.sent += len(sent)
    stream = damaged(b"".join(map(packet, sent)), noise, rng)
    # On a bad line a packet may be interrupted for so long that it counts as cut off.
    session.trickle(stream, 0.15 if noise else 0.05, rng)
    session.wait(0.2)
    arrived = log.since()[before:]
    understood = packets_in(stream)
    known = [decode_command(each) for each in understood if _decodes(each)]
    taken = {(each.number, each.argument) for each in known}
    tally.obeyed += len(arrived)
    tally.unsent += sum((each.number, each.argument) not in taken for each in arrived)
    if not numbers_in(stream) & set(MOTIONS):
        tally.unasked += robot.odometry != (0.0, 0.0, 0.0) or robot.speed_mps != 0.0
    session.resume()
    last = [(each.number, each.argument) for each in log.since()[-2:]]
    tally.deaf += last != [(Command.ENABLE, 1), (Command.VEL, 200)] or not robot.motors_enabled
    # From here on nothing valid is sent, only garbage.
    until = session.now + 2 * WATCHDOG_S
    while session.now < until:
        garbage = rng.randbytes(rng.randrange(200))
        if not packets_in(garbage):
            session.say(garbage)
        session.wait(0.15)
    tally.restless += not robot.timed_out


def _decodes(payload: bytes) -> bool:
    try:
        decode_command(payload)
    except ValueError:
        return False
    return True


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("packets", type=int, nargs="?", default=1_000_000)
    parser.add_argument("--noise", type=float, default=0.01, help="part of bytes damaged")
    chosen = parser.parse_args()
    for name, make, reads in (
        ("status packets", some_status, read_status),
        ("commands", some_command, read_velocity),
    ):
        sys.stdout.write(f"{name}: {fuzz(chosen.packets, make, reads, chosen.noise)}\n")
    sessions = chosen.packets // _COMMANDS_A_SESSION // 10
    for name, make in (("a robot", any_command), ("a robot that stands", still_command)):
        sys.stdout.write(f"{name}: {fuzz_robot(sessions, make, chosen.noise)}\n")


if __name__ == "__main__":
    main()
