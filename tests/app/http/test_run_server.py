"""The server as a process: it prints its address, and leaves nothing behind when it ends."""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO, cast

import psutil
import pytest
import structlog

from app.http.run_server import _bind, _Lasting, run
from app.settings import Settings
from app.storage import StorageError
from app.storage.occupancy import occupied
from observer.errors import InputError

START_TIMEOUT_S = 60.0
PROGRAM = """
import sys
from pathlib import Path
from app.settings import Settings
from app.storage import StorageError
from app.http.run_server import run
sys.exit(run(Settings(port=0, data=Path(sys.argv[1]))))
"""


@contextmanager
def server(folder: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A server process and the link it printed."""
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        found = re.search(r"http://127\.0\.0\.1:\d+/\?token=\S+", process.stdout.readline())
        assert found is not None
        yield process, found.group()
    finally:
        process.kill()
        process.communicate()


def engines(process: psutil.Process) -> list[psutil.Process]:
    return [child for child in process.children(recursive=True) if child.is_running()]


def wait_until_ready(link: str) -> None:
    deadline = time.monotonic() + START_TIMEOUT_S
    url = link.partition("?")[0] + "readyz"
    while True:
        try:
            with urllib.request.urlopen(url, timeout=5):
                return
        except OSError:
            assert time.monotonic() < deadline, "the server did not become ready"
            time.sleep(0.05)


@pytest.mark.parametrize(
    "how",
    [
        signal.SIGTERM,
        pytest.param(signal.SIGINT, marks=pytest.mark.patient),
        pytest.param(signal.SIGKILL, marks=pytest.mark.patient),
    ],
)
def test_the_server_ends_on_a_signal_and_leaves_no_process(
    tmp_path: Path, how: signal.Signals
) -> None:
    with server(tmp_path) as (process, link):
        wait_until_ready(link)
        children = engines(psutil.Process(process.pid))
        assert children
        started = time.monotonic()
        process.send_signal(how)
        out, err = process.communicate(timeout=20)
        assert time.monotonic() - started < 8
        assert process.returncode == (-signal.SIGKILL if how is signal.SIGKILL else 0)
        _, alive = psutil.wait_procs(children, timeout=5)
        assert alive == []
        token = link.partition("=")[2]
        assert token not in err
        assert "Traceback" not in out + err


def test_a_busy_port_is_reported(tmp_path: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(InputError, match=f"port {port} of 127.0.0.1 is in use .* --port$"):
            run(Settings(port=port, data=tmp_path))
    assert not list(tmp_path.iterdir())


def test_a_data_folder_is_exclusive_and_free_after_any_exit(tmp_path: Path) -> None:
    for _ in range(2):
        # The second server follows one that was killed.
        with (
            server(tmp_path) as (process, _),
            pytest.raises(InputError, match=f"process {process.pid}.*--data"),
        ):
            run(Settings(port=0, data=tmp_path))


def test_a_database_is_exclusive_across_data_folders(tmp_path: Path) -> None:
    database = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    with (
        occupied(tmp_path / "one", database),
        pytest.raises(InputError, match=r"is using the database .*shared\.sqlite.*--database"),
    ):
        run(Settings(port=0, data=tmp_path / "other", database=database))


def test_an_unusable_database_is_reported(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("no folder")
    with pytest.raises(StorageError, match="choose a folder"):
        run(Settings(port=0, data=blocked / "data"))


def test_an_address_of_another_machine_is_reported(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--host"):
        _bind(Settings(host="192.0.2.1", port=0, data=tmp_path))
    with pytest.raises(InputError, match="--host"):
        _bind(Settings(host="no such host", port=0, data=tmp_path))


def test_a_bad_certificate_is_reported(tmp_path: Path) -> None:
    cert = tmp_path / "cert.pem"
    cert.write_text("nothing of the kind")
    for key in (cert, tmp_path / "missing.pem"):
        with pytest.raises(InputError, match="--tls-cert"):
            run(Settings(port=0, data=tmp_path / "data", tls_cert=cert, tls_key=key))


def test_logging_to_a_full_disk_loses_messages_without_errors() -> None:
    # Linux's full disk; closing it tries to write the rest of its buffer.
    full = Path("/dev/full").open("w", buffering=1)  # noqa: SIM115
    try:
        with pytest.raises(OSError, match="No space left"):
            structlog.PrintLogger(full).error("lost")
        # The logger needs only part of a text stream's interface.
        log = structlog.PrintLogger(cast(TextIO, _Lasting(full)))
        for _ in range(3):
            log.error("lost as well")
    finally:
        with suppress(OSError):
            full.close()
