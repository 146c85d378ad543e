"""What is written to a port, in which order and when."""

from __future__ import annotations

import itertools
import math
import os
import time
import tty
from collections.abc import Callable, Iterator, Sequence

import pytest

from observer.robots.arcos import Command, PacketParser, command, decode_command
from observer.robots.contract import SETPOINT_FRESH_S
from observer.robots.serial_port import PortLost, open_port
from observer.robots.setpoint_writer import RESEND_S, SetpointWriter, since_boot

VEL, RVEL, STOP = int(Command.VEL), int(Command.RVEL), int(Command.STOP)


class Wire:
    """A port that records what was written and when.

    Attributes:
        written: (host's monotonic clock, bytes) of each write.
    """

    name = "wire"
    serial_line = True

    def __init__(self, baud: int | None = 38400) -> None:
        self.baud = baud
        self.written: list[tuple[float, bytes]] = []
        self._cut = False

    def cut(self) -> None:
        self._cut = True

    def read(self, timeout_s: float) -> bytes:  # noqa: ARG002 - as Port
        raise PortLost("nobody reads")

    def write(self, data: bytes) -> None:
        if self._cut:
            raise PortLost("the wire was cut")
        self.written.append((time.monotonic(), data))

    def change_baud(self, baud: int) -> None:
        self.baud = baud

    def close(self, *, discard: bool) -> None:  # noqa: ARG002 - as Port
        self._cut = True

    def commands(self, since: float = 0.0) -> list[tuple[int, int | bytes | None]]:
        """Return one command per write; each write must be one complete command."""
        found = []
        for at, data in list(self.written):
            (payload,) = PacketParser().feed(data)
            read = decode_command(payload)
            if at >= since:
                found.append((read.number, read.argument))
        return found


@pytest.fixture
def writing() -> Iterator[Callable[..., tuple[Wire, SetpointWriter]]]:
    made = []

    def make(
        baud: int | None = 38400,
        clock: Callable[[], float] = time.monotonic,
        since_boot: Callable[[], float] = since_boot,
    ) -> tuple[Wire, SetpointWriter]:
        wire = Wire(baud)
        writer = SetpointWriter(wire, clock, since_boot)
        made.append(writer)
        return wire, writer

    yield make
    for writer in made:
        assert writer.finish(2.0)


def hold(writer: SetpointWriter, setpoint: tuple[int, int], seconds: float) -> None:
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        writer.drive(setpoint)
        time.sleep(0.01)


Writing = Callable[..., tuple[Wire, SetpointWriter]]


def stands_from(told: Sequence[tuple[int, int | bytes | None]]) -> int:
    """Return the index of the stop from which on a robot is told nothing but a standstill."""
    at = told.index((STOP, None))
    assert told[at : at + 3] == [(STOP, None), (VEL, 0), (RVEL, 0)]
    assert (VEL, 300) not in told[at:]
    return at


def test_a_velocity_is_sent_as_two_commands_and_repeated(writing: Writing) -> None:
    wire, writer = writing()
    hold(writer, (300, -20), 0.6)
    told = wire.commands()
    moving = told[told.index((RVEL, -20)) :]
    # It turns before it speeds up; from then on the order alternates.
    assert moving[:4] == [(RVEL, -20), (VEL, 300), (VEL, 300), (RVEL, -20)]
    assert 4 <= moving.count((VEL, 300)) <= 8
    assert writer.sent is not None
    assert (writer.sent.speed_mps, writer.sent.turn_rate_radps) == (0.3, math.radians(-20))


def test_commands_are_at_least_3_ms_apart(writing: Writing) -> None:
    wire, writer = writing()
    for each in range(50):
        writer.drive((each, each))
        time.sleep(0.002)
    times = [at for at, _ in wire.written]
    assert min(b - a for a, b in itertools.pairwise(times)) >= 0.003


def test_zero_is_sent_at_once_and_forward_speed_first(writing: Writing) -> None:
    worst = 0.0
    for baud in (9600, None):
        wire, writer = writing(baud)
        for _ in range(3):
            hold(writer, (300, 20), 0.11)
            since = time.monotonic()
            writer.drive((0, 0))
            time.sleep(0.04)
            zero = next(
                at for at, data in wire.written if at >= since and data == command(Command.VEL, 0)
            )
            worst = max(worst, zero - since)
            following = wire.commands(zero)
            assert following[:2] == [(VEL, 0), (RVEL, 0)]
    assert worst < 0.1


def test_a_velocity_that_is_not_repeated_becomes_zero(writing: Writing) -> None:
    wire, writer = writing()
    hold(writer, (300, 0), 0.2)
    since = time.monotonic()
    time.sleep(SETPOINT_FRESH_S + 0.25)
    told = wire.commands(since)
    zero = next(at for at, data in wire.written if at > since and data == command(VEL, 0))
    assert zero - since < SETPOINT_FRESH_S + 0.1
    assert (VEL, 300) not in told[told.index((VEL, 0)) :]
    # Zero is repeated as well, or the firmware's watchdog would expire.
    assert told[told.index((VEL, 0)) :].count((VEL, 0)) >= 2


def test_halting_precedes_everything_queued(writing: Writing) -> None:
    wire, writer = writing()
    hold(writer, (300, 0), 0.15)
    writer.send(*[command(Command.SONAR, 1)] * 50)
    since = time.monotonic()
    writer.halt(command(Command.E_STOP), command(Command.ENABLE, 0))
    time.sleep(RESEND_S * 2.5)
    told = wire.commands(since)
    # A command in transit at that moment may come first.
    at = told.index((int(Command.E_STOP), None))
    assert at <= 1
    assert told[at + 1] == (int(Command.ENABLE), 0)
    assert set(told[at + 2 :]) == {(VEL, 0), (RVEL, 0)}


def test_a_hard_stop_is_not_lost_to_a_soft_one(writing: Writing) -> None:
    wire, writer = writing()
    writer.send(*[command(Command.SONAR, 1)] * 50)
    time.sleep(0.02)
    writer.halt(command(Command.E_STOP), command(Command.ENABLE, 0))
    writer.halt(command(Command.ENABLE, 0))
    time.sleep(0.05)
    told = wire.commands()
    stop = (int(Command.E_STOP), None)
    assert told.count(stop) == 1
    assert told[told.index(stop) + 1] == (int(Command.ENABLE), 0)


def test_a_rising_velocity_does_not_fill_a_slow_line(writing: Writing) -> None:
    wire, writer = writing(9600)
    began = time.monotonic()
    for each in range(1, 101):
        writer.drive((each, 0))
        time.sleep(0.005)
    took = time.monotonic() - began
    size = sum(len(data) for _, data in wire.written)
    assert size / took < 0.6 * 960


def test_every_velocity_is_a_standstill_during_an_outage(writing: Writing) -> None:
    wire, writer = writing()
    hold(writer, (300, 0), 0.15)
    writer.in_outage(True)
    time.sleep(0.02)
    since = time.monotonic()
    hold(writer, (300, 0), 0.35)
    told = wire.commands(since)
    stands_from(told)
    since = time.monotonic()
    writer.in_outage(False)
    hold(writer, (300, 0), 0.15)
    told = wire.commands(since)
    first = told.index((VEL, 300))
    assert told[first - 4 : first - 1] == [(STOP, None), (VEL, 0), (RVEL, 0)]


def test_a_suspended_process_resumes_with_a_standstill(writing: Writing) -> None:
    ahead = [0.0]
    late = lambda: time.monotonic() + ahead[0]  # noqa: E731
    wire, writer = writing(clock=late, since_boot=late)
    hold(writer, (300, 0), 0.15)
    # As if the process had been stopped for 3 s: it notices only by the clock.
    ahead[0] = 3.0
    since = time.monotonic()
    time.sleep(0.2)
    told = wire.commands(since)
    assert writer.frozen
    assert stands_from(told) <= 1


def test_a_suspended_computer_resumes_with_a_standstill(writing: Writing) -> None:
    asleep = [0.0]
    # The monotonic clock stands still meanwhile, so the last velocity still looks fresh.
    wire, writer = writing(since_boot=lambda: time.monotonic() + asleep[0])
    hold(writer, (300, 0), 0.15)
    asleep[0] = 3600.0
    since = time.monotonic()
    hold(writer, (300, 0), 0.3)
    told = wire.commands(since)
    assert writer.frozen
    assert stands_from(told) <= 1
    # Its owner decides when the robot may move again.
    writer.frozen = False
    since = time.monotonic()
    hold(writer, (300, 0), 0.15)
    assert (VEL, 300) in wire.commands(since)


def test_a_lost_port_ends_the_writer_with_the_reason(writing: Writing) -> None:
    wire, writer = writing()
    wire.cut()
    hold(writer, (300, 0), 0.1)
    assert writer.broken == "the wire was cut"
    assert (VEL, 300) not in wire.commands()


def test_a_stuck_port_blocks_no_call() -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    port = open_port(os.ttyname(slave))
    writer = SetpointWriter(port, time.monotonic)
    try:
        # The other end is not read; a pseudo terminal buffers some kilobytes.
        writer.send(*[command(Command.SONAR, bytes(200))] * 100)
        longest, until = 0.0, time.monotonic() + 4.0
        while writer.broken is None and time.monotonic() < until:
            began = time.monotonic()
            writer.drive((300, 0))
            writer.halt(*[command(Command.SONAR, bytes(200))] * 100)
            longest = max(longest, time.monotonic() - began)
            time.sleep(0.05)
        assert writer.broken is not None
        assert "no longer accepts data" in writer.broken
        assert longest < 0.1
    finally:
        assert writer.finish(2.0)
        port.close(discard=True)
        os.close(master)
        os.close(slave)
