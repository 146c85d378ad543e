"""Server process started for a measurement and removed afterwards."""

from __future__ import annotations

import socket
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.addresses import token_link
from app.client.server_api import ServerApi
from observer.errors import DynamicObserverError

_START_TIMEOUT_S = 60.0
_STOP_TIMEOUT_S = 15.0
_REQUEST_TIMEOUT_S = 20.0


class MeasurementError(DynamicObserverError):
    """Failure of a measurement."""


@dataclass(frozen=True)
class RunningServer:
    """Address and data of a server started for a measurement.

    Attributes:
        port: on 127.0.0.1. token: valid for every route. started: monotonic time of its start.
        pid: of its process. data: its data folder.
    """

    port: int
    token: str
    started: float
    pid: int
    data: Path

    @property
    def link(self) -> str:
        """Return the link that signs a browser in."""
        return token_link(f"http://127.0.0.1:{self.port}", self.token)

    def request(self, method: str, path: str, body: Any = None) -> Any:
        """Send one REST request, from any thread, and return the decoded JSON reply.

        Raises:
            MeasurementError: the server refused it; the sentence is the server's.
        """
        api = ServerApi(f"http://127.0.0.1:{self.port}", self.token, timeout_s=_REQUEST_TIMEOUT_S)
        try:
            return api.request(method, *path.removeprefix("/api/").split("/"), body=body)
        except DynamicObserverError as error:
            raise MeasurementError(str(error)) from None
        finally:
            api.close()

    def wait_for_frames(self, timeout_s: float = _START_TIMEOUT_S) -> None:
        """Wait until the server observes its source.

        Raises:
            MeasurementError: it does not start in time; the sentence gives the engine's reason.
        """
        deadline = time.monotonic() + timeout_s
        while True:
            status = self.request("GET", "/api/status")
            if status["frames_observed"] > 0:
                return
            if time.monotonic() > deadline:
                raise MeasurementError(
                    f"the server processed no frame within {timeout_s:g} s: "
                    f"{status['engine']['reason'] or status['engine']['state']}"
                )
            time.sleep(0.1)


@contextmanager
def running_server(source: str) -> Iterator[RunningServer]:
    """Serve ``source`` on a free port from an empty data folder; stop the server after the block.

    Raises:
        MeasurementError: the server did not answer in time; the sentence gives its last output.
    """
    with tempfile.TemporaryDirectory(prefix="dynamic-observer-benchmark-") as folder:
        token_file = Path(folder) / "token"
        log_path = Path(folder) / "server.log"
        port = _free_port()
        started = time.monotonic()
        with log_path.open("w") as log:
            process = subprocess.Popen(
                [
                    *(sys.executable, "-m", "app.cli", "serve", source),
                    *("--port", str(port), "--data", folder, "--token-file", str(token_file)),
                ],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
            )
            with ended_after(process, _STOP_TIMEOUT_S):
                _wait_until_ready(process, port, log_path)
                token = token_file.read_text().strip()
                yield RunningServer(port, token, started, process.pid, Path(folder))


@contextmanager
def ended_after(process: subprocess.Popen[bytes], timeout_s: float) -> Iterator[None]:
    """End a process after the block, by force if it takes longer than ``timeout_s`` seconds."""
    try:
        yield
    finally:
        process.terminate()
        try:
            process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _wait_until_ready(process: subprocess.Popen[bytes], port: int, log: Path) -> None:
    deadline = time.monotonic() + _START_TIMEOUT_S
    while time.monotonic() < deadline and process.poll() is None:
        try:
            # The address is this server's own, with a fixed scheme.
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/readyz", timeout=2):  # nosec B310
                return
        except (urllib.error.URLError, OSError):
            time.sleep(0.05)
    last_words = " ".join(log.read_text(errors="replace").split())[-300:]
    raise MeasurementError(f"the server did not become ready on port {port}: {last_words}")
