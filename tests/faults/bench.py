"""Test bench for the whole system with an emulated robot: the server, retries and reports."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import psutil

from ..waiting import until

# How often each fault is tried; ``make faults`` uses 100.
TRIALS = int(os.environ.get("FAULT_TRIALS", "1"))
# It takes six seconds on an idle machine.
_START_S = 120.0
_STOP_S = 15.0


class Refused(Exception):
    """The server refused a request.

    Attributes:
        status: of the answer.
    """

    def __init__(self, status: int, said: str) -> None:
        self.status = status
        super().__init__(f"{status}: {said}")


@dataclass
class Server:
    """A server as a user starts it.

    Attributes:
        process: the web process. link: signs a browser in. port, token: of its page.
        api: a client for the REST interface, signed in.
    """

    process: psutil.Process
    link: str
    port: int
    token: str
    api: httpx.Client

    def request(self, method: str, path: str, body: Any = None, **more: Any) -> Any:
        """Make a REST call below ``/api``; return the decoded answer.

        Raises:
            Refused: the answer is an error.
        """
        answer = self.api.request(method, f"/api{path}", json=body, **more)
        if not answer.is_success:
            raise Refused(answer.status_code, answer.text)
        return answer.json() if answer.content else None

    def upload(self, path: str, name: str, content: bytes) -> Any:
        """Upload a file as a form does."""
        return self.request("POST", path, files={"file": (name, content)})

    def robot(self, role: str = "observer") -> dict[str, Any]:
        """Return the facts of one robot; empty if it has no port."""
        facts: dict[str, Any] | None = self.request("GET", "/robots")["robots"][role]
        return facts or {}


@contextmanager
def served(
    folder: Path, source: str, environment: Mapping[str, str] | None = None
) -> Iterator[Server]:
    """Run a server on a free port with its data in ``folder``; it is always ended afterwards.

    Args:
        environment: variables for its processes in addition to our own.
    """
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / "server.log"
    command = [sys.executable, "-m", "app.cli", "serve", source, "--port", "0"]
    command += ["--data", str(folder), "--token-file", str(folder / "token")]
    with log.open("a") as stream:
        stream.truncate(0)
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=stream, stderr=subprocess.STDOUT,
            env={**os.environ, **(environment or {})},
        )  # fmt: skip
    children: list[psutil.Process] = []
    try:
        link = _wait_for_link(process, log)
        address, _, token = link.partition("/?token=")
        bearer = {"Authorization": f"Bearer {token}"}
        # Do not keep connections alive: the server may be killed at any time.
        alone = httpx.Limits(max_keepalive_connections=0)
        with httpx.Client(
            base_url=address, headers=bearer, timeout=20, trust_env=False, limits=alone
        ) as api:
            port = api.base_url.port
            assert port is not None
            yield Server(psutil.Process(process.pid), link, port, token, api)
        children = psutil.Process(process.pid).children(recursive=True)
        process.send_signal(signal.SIGTERM)
        process.wait(_STOP_S)
    except psutil.NoSuchProcess:
        # A test killed it.
        process.wait(_STOP_S)
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGCONT)
            process.kill()
            process.wait()
        psutil.wait_procs(children, 3.0)


def _wait_for_link(process: subprocess.Popen[bytes], log: Path) -> str:
    deadline = time.monotonic() + _START_S
    while time.monotonic() < deadline and process.poll() is None:
        found = re.search(r"http://\S+/\?token=\S+", log.read_text())
        if found:
            return found.group()
        time.sleep(0.05)
    raise AssertionError(f"the server gave no link: {log.read_text()[-2000:]}")


def tell(line: str) -> None:
    """Print a line for whoever runs the tests (``pytest -s``)."""
    sys.stdout.write(f"\n{line}\n")


def wait_until(what: str, true: Callable[[], Any], timeout_s: float = 10.0) -> Any:
    """Ask until the answer is true; return the answer.

    Raises:
        AssertionError: it never was true; ``what`` names what was awaited.
    """
    return until(true, what, timeout_s, pause_s=0.02)
