"""Damages streams of packets and counts what still comes through as something else.

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

_CHUNK = 200
_VELOCITIES = (Command.VEL, Command.RVEL, Command.VEL2, Command.ENABLE)


@dataclasses.dataclass
class Tally:
    """What a fuzz came to.

    Attributes:
        sent: packets. whole: received as sent. lost: never received. altered: received with a
            right checksum but unlike every packet sent: what 16 bits of checksum let through.
        misread: altered ones that are taken for a status packet, or for a velocity or ENABLE
            other than was sent. raised: anything raised that is no refusal.
        seconds: it took.
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


def some_status(rng: random.Random) -> bytes:
    """A status packet as a moving robot sends it."""
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
    """What a driver sends, mostly velocities."""
    number = rng.choice((Command.VEL, Command.RVEL, Command.VEL, Command.RVEL, Command.STOP))
    argument = None if number is Command.STOP else rng.randrange(-500, 501)
    return command(number, argument)[3:-2]


def damaged(stream: bytes, noise: float, rng: random.Random) -> bytes:
    """Replace, drop, double and insert bytes, each byte with the probability ``noise``."""
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
    """Whether a driver would take it for a status packet."""
    if not is_status(payload):
        return False
    try:
        decode_status(payload, robot_spec("p3dx-sh"), 5, 5)
    except ValueError:
        return False
    return True


def read_velocity(payload: bytes) -> bool:
    """Whether a robot would take it for a velocity or for switching its motors."""
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
    """Send so many packets through noise in arbitrary pieces, and compare what arrives."""
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


if __name__ == "__main__":
    main()
