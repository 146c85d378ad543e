"""``emulate`` as a shell sees it: a process with a robot that answers at its port."""

from __future__ import annotations

import os
import select
import signal
import socket
import subprocess
import sys
import termios
import time
import tty
from collections.abc import Callable

import pytest

from observer.robots.arcos import Command, PacketParser, command
from observer.robots.config_reply import decode_config

START = [sys.executable, "-m", "app.cli", "emulate"]


def handshake(write: Callable[[bytes], object], read: Callable[[], bytes]) -> list[bytes]:
    """Return the names and the settings that a robot answers with."""
    parser = PacketParser()
    found: list[bytes] = []

    def ask(number: int, kind: int) -> None:
        write(command(number))
        deadline = time.monotonic() + 10
        while not any(each[0] == kind for each in found):
            assert time.monotonic() < deadline, f"command {number} is not answered"
            found.extend(parser.feed(read()))

    for number in (0, 1, 2):
        ask(number, number)
    write(command(Command.OPEN))
    ask(Command.CONFIG, 0x20)
    write(command(Command.CLOSE))
    return [each for each in found if each[0] in (0x02, 0x20)]


def test_a_robot_answers_on_the_printed_port_until_ctrl_c() -> None:
    with subprocess.Popen(
        [*START, "p3dx-sh", "--watchdog", "1.5"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        try:
            assert process.stdout is not None
            host, port = process.stdout.readline().strip().removeprefix("socket://").split(":")
            assert host == "127.0.0.1"
            with socket.create_connection((host, int(port)), 5) as client:
                client.settimeout(5)
                names, config = handshake(client.sendall, lambda: client.recv(4096))
                # The robot disconnects once it has read all that was sent.
                client.shutdown(socket.SHUT_WR)
                while client.recv(4096):
                    pass
            assert names.split(b"\0")[1:3] == [b"Pioneer", b"p3dx-sh"]
            assert decode_config(config).watchdog_ms == 1500
            process.send_signal(signal.SIGINT)
            _, said = process.communicate(timeout=20)
        finally:
            process.kill()
    assert process.returncode == 0, said
    assert "Pioneer P3-DX" in said
    assert "it received 6 commands" in said


def test_a_robot_answers_on_a_pseudo_terminal() -> None:
    with subprocess.Popen(
        [*START, "amigo-sh", "--pty"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            terminal = os.open(process.stdout.readline().strip(), os.O_RDWR | os.O_NOCTTY)
            tty.setraw(terminal, termios.TCSANOW)

            def read() -> bytes:
                ready = select.select([terminal], [], [], 5)[0]
                return os.read(terminal, 4096) if ready else b""

            names, _ = handshake(lambda data: os.write(terminal, data), read)
            os.close(terminal)
        finally:
            process.kill()
    assert names.split(b"\0")[2] == b"amigo-sh"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["p4dx"], "there is no robot model 'p4dx'; available are p3dx-sh, p3dx, amigo-sh, amigo"),
        (["amigo", "--pty", "--tcp", "0"], "give --tcp or --pty, not both"),
        (["amigo", "--watchdog", "0"], "must be greater than or equal to 0.1"),
    ],
)
def test_invalid_arguments_give_a_one_line_error(arguments: list[str], says: str) -> None:
    done = subprocess.run(
        [*START, *arguments], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 2
    assert says in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
