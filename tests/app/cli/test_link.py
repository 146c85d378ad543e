"""The links of a running server, found by its data folder."""

from __future__ import annotations

import json
import socket
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest

from app.client.announced import ANNOUNCED_FILE, AnnouncedServer, announced, find_server
from observer.errors import InputError

from .shell import Shell


@pytest.fixture
def running(tmp_path: Path) -> Iterator[AnnouncedServer]:
    """A server that listens on every address; it gets no requests."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        server = AnnouncedServer(
            host="0.0.0.0",
            port=listener.getsockname()[1],
            tls=False,
            allowed_hosts=("lab.example",),
            token="o" * 43,
            read_only_token="r" * 43,
        )
        with announced(tmp_path, server):
            yield server


def test_the_announcement_file_is_private_and_removed_at_exit(tmp_path: Path) -> None:
    file = tmp_path / ANNOUNCED_FILE
    server = AnnouncedServer(
        host="::1", port=9, tls=True, allowed_hosts=(), token="t", read_only_token="r"
    )
    with announced(tmp_path, server):
        assert stat.S_IMODE(file.stat().st_mode) == 0o600
        assert "t" in file.read_text()
    assert not list(tmp_path.iterdir())
    # Where nothing can be written, the server runs all the same, and leaves no token behind.
    with announced(tmp_path / "missing", server):
        pass
    file.mkdir()
    with announced(tmp_path, server):
        assert list(tmp_path.iterdir()) == [file]


def test_links_and_a_qr_code_are_printed(
    shell: Shell, tmp_path: Path, running: AnnouncedServer
) -> None:
    done = shell("link", "--data", str(tmp_path))
    assert done.code == 0, done.err
    first = f"http://lab.example:{running.port}/?token={running.token}"
    assert done.out.splitlines()[2].strip() == first
    assert f"http://localhost:{running.port}/?token={running.token}   (this computer" in done.out
    assert "█" in done.out
    assert running.read_only_token not in done.out
    assert "\x1b" not in done.out
    assert "█" not in shell("link", "--data", str(tmp_path), "--no-qr").out


def test_read_only_links_contain_a_separate_token(
    shell: Shell, tmp_path: Path, running: AnnouncedServer
) -> None:
    done = shell("link", "--data", str(tmp_path), "--read-only", "--json")
    told = json.loads(done.out)
    assert told["access"] == "read_only"
    assert told["here"] == f"http://localhost:{running.port}/?token={running.read_only_token}"
    assert running.token not in done.out


def test_the_next_step_is_suggested_when_no_server_is_running(
    shell: Shell, tmp_path: Path, free_port: int
) -> None:
    done = shell("link", "--data", str(tmp_path))
    assert (done.code, done.out) == (2, "")
    assert "no server is running" in done.err
    assert "dynamic-observer serve" in done.err
    # Left behind by a killed server.
    left = AnnouncedServer(
        host="127.0.0.1",
        port=free_port,
        tls=False,
        allowed_hosts=(),
        token="t",
        read_only_token="r",
    )
    (tmp_path / ANNOUNCED_FILE).write_text(left.model_dump_json())
    with pytest.raises(InputError, match="no server is running"):
        find_server(tmp_path)
    (tmp_path / ANNOUNCED_FILE).write_text("{}")
    with pytest.raises(InputError, match="damaged"):
        find_server(tmp_path)
