"""A small private PostgreSQL server for the tests, from the system's packages."""

from __future__ import annotations

import ctypes
import os
import pwd
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

MISSING = "no PostgreSQL server on this machine: make system"

_START_S = 30.0
_PR_SET_PDEATHSIG = 1
# Test data need not survive a power cut.
_FORGETFUL = (
    "fsync=off", "synchronous_commit=off", "full_page_writes=off", "shared_buffers=16MB",
    "max_connections=40", "autovacuum=off", "listen_addresses=", "log_min_messages=fatal",
)  # fmt: skip
# Text is sorted differently from SQLite, so that nothing relies on either order.
_LOCALES = (["--locale-provider=icu", "--icu-locale=en", "--locale=C.UTF-8"], ["--locale=C"])


class CannotStart(Exception):
    """There is no server; the message is one sentence saying why."""


@dataclass
class PrivateServer:
    """A server reached over a socket in its own folder.

    Attributes:
        folder: everything it stores. bin: its programs. user: who runs it.
    """

    folder: Path
    bin: Path
    user: dict[str, Any]
    process: subprocess.Popen[bytes] | None = None

    def url(self, database: str) -> str:
        """Return the URL of a database, as for ``--database``."""
        return f"postgresql://observer@/{database}?host={self.folder}"

    def start(self) -> None:
        """Start the server; return when it answers."""
        command = [str(self.bin / "postgres"), "-D", str(self.folder / "data")]
        command += ["-k", str(self.folder)]
        for each in _FORGETFUL:
            command += ["-c", each]
        log = (self.folder / "log").open("ab")
        with log:
            # The code between fork and exec makes only system calls, so threads do no harm.
            self.process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, cwd=self.folder,
                env=_ENVIRONMENT, preexec_fn=_as_user_until_the_parent_dies(self.user),  # noqa: PLW1509
            )  # fmt: skip
        deadline = time.monotonic() + _START_S
        ready = [str(self.bin / "pg_isready"), "-q", "-h", str(self.folder)]
        while subprocess.run(ready, check=False).returncode != 0:
            if self.process.poll() is not None or time.monotonic() > deadline:
                self.stop()
                said = (self.folder / "log").read_text(errors="replace")
                raise CannotStart(f"PostgreSQL does not start: {' '.join(said[-500:].split())}")
            time.sleep(0.05)

    def stop(self) -> None:
        """Stop it at once: its data are not needed."""
        if self.process is not None and self.process.poll() is None:
            self.process.send_signal(signal.SIGQUIT)
            try:
                self.process.wait(10)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()

    def run(self, statement: str, database: str = "postgres") -> str:
        """Run one statement by psql; return its undecorated output."""
        command = [str(self.bin / "psql"), "-h", str(self.folder), "-U", "observer", "-AtqX"]
        done = subprocess.run(
            [*command, "-v", "ON_ERROR_STOP=1", "-d", database, "-c", statement],
            capture_output=True, text=True, check=True, env=_ENVIRONMENT, timeout=60,
        )  # fmt: skip
        return done.stdout.strip()


_ENVIRONMENT = {
    **{name: value for name, value in os.environ.items() if not name.startswith("PG")},
    "LC_ALL": "C.UTF-8",
    "TZ": "UTC",
}


@contextmanager
def private_server() -> Iterator[PrivateServer]:
    """Run a new server, which is removed afterwards with all its data.

    Raises:
        CannotStart: it is not installed on this machine, or there is no user to run it as.
    """
    bin = _programmes()
    user = _user()
    # Not below pytest's folder, which only this user can access; a socket path must also be short.
    folder = Path(tempfile.mkdtemp(prefix="observer-pg-"))
    try:
        if user:
            os.chown(folder, user["user"], user["group"])
        _initialise(bin, folder, user)
        server = PrivateServer(folder, bin, user)
        server.start()
        try:
            yield server
        finally:
            server.stop()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _programmes() -> Path:
    """Return the folder of its programs; Debian keeps them off the path, by version."""
    folders = sorted(Path("/usr/lib/postgresql").glob("*/bin"), key=_version, reverse=True)
    on_path = shutil.which("initdb")
    folders += [Path(on_path).resolve().parent] if on_path else []
    for folder in folders:
        if (folder / "initdb").exists() and (folder / "postgres").exists():
            return folder
    raise CannotStart(MISSING)


def _version(folder: Path) -> float:
    try:
        return float(folder.parent.name)
    except ValueError:
        return 0.0


def _user() -> dict[str, Any]:
    """Return the user to run it as, since it refuses root; empty if we are not root."""
    if os.getuid() != 0:
        return {}
    for name in ("postgres", "nobody"):
        try:
            entry = pwd.getpwnam(name)
        except KeyError:
            continue
        return {"user": entry.pw_uid, "group": entry.pw_gid}
    raise CannotStart("PostgreSQL is not run by root, and there is no user postgres or nobody")


def _initialise(bin: Path, folder: Path, user: dict[str, Any]) -> None:
    data = folder / "data"
    command = [str(bin / "initdb"), "-D", str(data), "-U", "observer", "-A", "trust"]
    command += ["-E", "UTF8", "--no-sync", "--no-instructions"]
    said = ""
    as_user = {**user, "extra_groups": []} if user else {}
    for locale in _LOCALES:
        done = subprocess.run(
            [*command, *locale], cwd=folder, env=_ENVIRONMENT, capture_output=True, text=True,
            stdin=subprocess.DEVNULL, check=False, timeout=60, **as_user,
        )  # fmt: skip
        if done.returncode == 0:
            return
        said = done.stderr
        shutil.rmtree(data, ignore_errors=True)
    raise CannotStart(f"PostgreSQL cannot be set up: {' '.join(said[-500:].split())}")


def _as_user_until_the_parent_dies(user: dict[str, Any]) -> Callable[[], None]:
    """Return a function that makes Linux end the server with its parent, even if that is killed."""
    prctl = getattr(ctypes.CDLL(None), "prctl", None)

    def prepare() -> None:
        if user:
            os.setgroups([])
            os.setgid(user["group"])
            os.setuid(user["user"])
        # After the change of user, which would reset it.
        if prctl is not None:
            prctl(_PR_SET_PDEATHSIG, signal.SIGQUIT, 0, 0, 0)

    return prepare
