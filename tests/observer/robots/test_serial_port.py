"""Names of things that are not ports: refused in a sentence, and not even opened."""

from __future__ import annotations

import fcntl
import os
import select
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from observer.robots.serial_port import PortLost, open_port


@pytest.fixture
def others(tmp_path: Path) -> Iterator[dict[str, Path]]:
    """Return one path of each kind."""
    paths = {name: tmp_path / name.split()[-1] for name in KINDS}
    paths["a file"].write_bytes(b"settings")
    paths["a folder"].mkdir()
    os.mkfifo(paths["a named pipe"])
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(paths["a local socket"]))
        yield paths


KINDS = ("a file", "a folder", "a named pipe", "a local socket")


@pytest.mark.parametrize("kind", KINDS)
def test_other_kinds_of_files_are_refused_by_kind(others: dict[str, Path], kind: str) -> None:
    path = others[kind]
    link = path.with_name("ttyUSB0")
    link.symlink_to(path)
    for name in (path, link):
        with pytest.raises(PortLost) as told:
            open_port(str(name))
        assert str(told.value) == f"{name} cannot be opened: it is {kind}, not a serial port"


@pytest.mark.parametrize("path", ["/dev/null", "/dev/zero", "/dev/random"])
def test_other_devices_are_refused(path: str) -> None:
    with pytest.raises(PortLost, match=r"it is (no|another kind of device, not a) serial port"):
        open_port(path)


def test_a_refused_file_is_not_opened(others: dict[str, Path]) -> None:
    # Opening a file as a port locks it.
    file, pipe = others["a file"], others["a named pipe"]
    before = file.stat()
    with file.open("rb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with pytest.raises(PortLost, match="is a file"):
            open_port(str(file))
    assert file.read_bytes() == b"settings"
    assert file.stat().st_mtime_ns == before.st_mtime_ns
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        with pytest.raises(PortLost, match="is a named pipe"):
            open_port(str(pipe))
        poll = select.poll()
        poll.register(reader)
        # It would report a hang-up if the other end had ever been opened.
        assert poll.poll(0) == []
    finally:
        os.close(reader)


def test_a_missing_device_is_reported_and_a_real_one_is_opened(tmp_path: Path) -> None:
    with pytest.raises(PortLost, match="there is no such device; is it plugged in"):
        open_port(str(tmp_path / "ttyUSB7"))
    ours, theirs = os.openpty()
    try:
        port = open_port(os.ttyname(theirs))
        port.write(b"stop")
        assert os.read(ours, 10) == b"stop"
        port.close(discard=True)
    finally:
        os.close(ours)
        os.close(theirs)
