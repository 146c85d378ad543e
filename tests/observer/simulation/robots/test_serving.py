"""A served robot on real ports, TCP and pseudo terminal, on a healthy line and on a bad one."""

from __future__ import annotations

import errno
import os
import select
import socket
import termios
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from observer.errors import InputError
from observer.robots.arcos import Command, PacketParser, command
from observer.simulation.robots.emulated import EmulatedRobot
from observer.simulation.robots.serving import Serving, serve_pty, serve_tcp

from ....waiting import until

SYNC = [command(k) for k in (0, 1, 2)]
Robots = Serving[EmulatedRobot]


class Client:
    """Receives from a robot: bytes, and how many packets were in them."""

    def __init__(self, write: Callable[[bytes], object], fd: int) -> None:
        self.write = write
        self.parser = PacketParser()
        self._fd = fd

    def hear(self, seconds: float) -> list[bytes]:
        """Return all packets that arrive within a time."""
        found: list[bytes] = []
        deadline = time.monotonic() + seconds
        while (rest := deadline - time.monotonic()) > 0:
            found += self.parser.feed(self.chunk(rest))
        return found

    def chunk(self, seconds: float) -> bytes:
        """Return what arrives first, or nothing."""
        if not select.select([self._fd], [], [], seconds)[0]:
            return b""
        return os.read(self._fd, 4096)

    def until(self, kind: int, seconds: float = 10) -> bytes:
        """Return the next packet of a type."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            for each in self.parser.feed(self.chunk(0.05)):
                if each[0] == kind:
                    return each
        raise AssertionError(f"no packet of type {kind} within {seconds} s")

    def open(self) -> None:
        """Do the handshake and leave an open session."""
        for k, each in enumerate(SYNC):
            self.write(each)
            self.until(k)
        self.write(command(Command.OPEN))
        self.until(0x32)


@pytest.fixture
def served() -> Iterator[Robots]:
    with serve_tcp(EmulatedRobot("p3dx-sh", now=time.monotonic())) as serving:
        yield serving


def address(serving: Robots) -> tuple[str, int]:
    host, port = serving.port.removeprefix("socket://").split(":")
    return host, int(port)


@contextmanager
def client_of(serving: Robots) -> Iterator[Client]:
    """Connect as soon as the previous client is gone and the port is open."""
    deadline = time.monotonic() + 10
    while True:
        with suppress(ConnectionRefusedError):
            connection = socket.create_connection(address(serving), 5)
            break
        assert time.monotonic() < deadline, "nobody answers at the port"
        time.sleep(0.01)
    with connection:
        until(lambda: serving.connected)
        yield Client(connection.sendall, connection.fileno())


def test_status_is_sent_repeatedly_and_commands_are_logged_with_their_time(
    served: Robots,
) -> None:
    with client_of(served) as client:
        client.open()
        assert 3 <= len(client.hear(1)) <= 12
        before = time.monotonic()
        client.write(command(Command.ENABLE, 1) + command(Command.VEL, 150))
        until(lambda: len(served.robot.log.since(before)) == 2)
        first, second = served.robot.log.since(before)
        assert (first.number, second.number, second.argument) == (4, 11, 150)
        assert before <= first.time <= second.time <= time.monotonic()
        until(lambda: served.robot.speed_mps > 0.1)
        client.write(command(Command.STOP))
        until(lambda: served.robot.speed_mps == 0.0)
    assert served.robot.log.unintended == 0


def test_a_second_client_is_refused_and_a_later_one_finds_the_session_open(
    served: Robots,
) -> None:
    with client_of(served) as client:
        client.open()
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(address(served), 5)
        client.hear(0.2)
    with client_of(served) as client:
        client.write(SYNC[0])
        # Status packets arrive during SYNC, because no client sent CLOSE.
        client.until(0x32)
        client.write(command(Command.CLOSE))
        client.open()


def refuses(served: Robots) -> bool:
    try:
        socket.create_connection(address(served), 5).close()
    except ConnectionRefusedError:
        return True
    return False


def test_unplugging_ends_the_connection_until_it_is_plugged_in_again(served: Robots) -> None:
    with client_of(served) as client:
        client.open()
        served.robot.faults.unplugged = True
        until(lambda: ended(client))
        assert refuses(served)
        served.robot.faults.unplugged = False
    with client_of(served) as client:
        client.until(0x32)


def ended(client: Client) -> bool:
    try:
        return select.select([client._fd], [], [], 0)[0] != [] and client.chunk(0) == b""
    except OSError as error:
        return error.errno in (errno.EIO, errno.ECONNRESET)


def test_silence_deafness_splitting_and_merging_are_simulated(served: Robots) -> None:
    with client_of(served) as client:
        client.open()
        faults, log = served.robot.faults, served.robot.log
        faults.silent = True
        client.hear(0.2)
        assert client.hear(0.5) == []
        count = log.count
        client.write(command(Command.PULSE))
        until(lambda: log.count > count)
        faults.silent, faults.deaf = False, True
        client.until(0x32)
        count = log.count
        client.write(command(Command.PULSE) * 5)
        client.hear(0.3)
        assert log.count == count
        faults.deaf, faults.split = False, True
        client.hear(0.2)
        chunks = [client.chunk(0.05) for _ in range(40)]
        assert 0 < max(map(len, chunks)) < 60
        assert sum(1 for each in chunks if 0 < len(each) <= 7) > 5
        found = [one for each in chunks for one in client.parser.feed(each)]
        faults.split = False
        assert len(found) > 1
        faults.merge_s = 0.5
        client.hear(0.6)
        together = PacketParser().feed(next(filter(None, (client.chunk(0.1) for _ in range(99)))))
        assert len(together) >= 3
        faults.merge_s = 0
        client.hear(0.6)
        assert client.parser.bad_packets == 0


def test_noise_damages_packets_both_ways_and_moves_nothing(served: Robots) -> None:
    with client_of(served) as client:
        client.open()
        client.write(command(Command.ENABLE, 1))
        client.hear(0.2)
        served.robot.faults.noise = 0.05
        log = served.robot.log
        log.intended = lambda speed, turn_rate: (speed, turn_rate) == (0.2, 0.0)
        count = log.count
        for _ in range(200):
            client.write(command(Command.VEL, 200))
            client.hear(0.005)
        client.hear(0.2)
        assert client.parser.bad_packets > 0
        # Each command has nine bytes, and 0.95 ** 9 is 0.63.
        assert 80 < log.count - count < 165
        assert log.bad_bytes > 70
        assert log.unintended == 0


def test_a_port_in_use_is_refused(served: Robots) -> None:
    with pytest.raises(InputError, match=r"port \d+ on this machine cannot be used"):
        serve_tcp(EmulatedRobot("amigo"), address(served)[1])


# ---------------------------------------------------------------------- pseudo terminals


@contextmanager
def terminal(path: str, rate: int = termios.B9600) -> Iterator[Client]:
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
    try:
        set_rate(fd, rate)
        yield Client(lambda data: os.write(fd, data), fd)
    finally:
        os.close(fd)


def set_rate(fd: int, rate: int) -> None:
    tty.setraw(fd, termios.TCSANOW)
    settings = termios.tcgetattr(fd)
    settings[4] = settings[5] = rate
    termios.tcsetattr(fd, termios.TCSANOW, settings)


def test_a_pseudo_terminal_keeps_its_name_when_plugged_in_again(tmp_path: Path) -> None:
    link = tmp_path / "robot"
    robot = EmulatedRobot("amigo-sh", now=time.monotonic())
    with serve_pty(robot, link) as serving:
        assert serving.port == str(link)
        with terminal(serving.port) as client:
            client.open()
            serving.robot.faults.unplugged = True
            until(lambda: ended(client))
            assert not link.is_symlink()
        serving.robot.faults.unplugged = False
        until(link.exists)
        with terminal(serving.port) as client:
            client.until(0x32)
    assert not link.is_symlink()


def test_a_client_at_the_wrong_rate_receives_no_packet(tmp_path: Path) -> None:
    robot = EmulatedRobot("p3dx-sh", now=time.monotonic())
    with serve_pty(robot, tmp_path / "robot", rates=True) as serving:
        with terminal(serving.port, termios.B38400) as client:
            client.write(SYNC[0])
            assert client.hear(0.3) == []
        with terminal(serving.port) as client:
            client.open()
            client.write(command(Command.HOSTBAUD, 2))
            until(lambda: robot.baud == 38400)
            client.hear(0.2)
            assert client.hear(0.5) == []
            set_rate(client._fd, termios.B38400)
            client.until(0x32)
            client.write(command(Command.CLOSE))
            until(lambda: robot.baud == 9600)
