"""A PostgreSQL server of the tests' own, from the system's packages: private and small."""

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
# What a test writes need not survive a power cut.
_FORGETFUL = (
    "fsync=off", "synchronous_commit=off", "full_page_writes=off", "shared_buffers=16MB",
    "max_connections=40", "autovacuum=off", "listen_addresses=", "log_min_messages=fatal",
)  # fmt: skip
# Text is ordered otherwise than SQLite orders it, so that nobody relies on either.
_LOCALES = (["--locale-provider=icu", "--icu-locale=en", "--locale=C.UTF-8"], ["--locale=C"])


class CannotStart(Exception):
    """One sentence says why there is no server."""


@dataclass
class PrivateServer:
    """Reached over a socket in its own folder.

    Attributes:
        folder: all that it is. bin: its programmes. user: who runs it.
    """

    folder: Path
    bin: Path
    user: dict[str, Any]
    process: subprocess.Popen[bytes] | None = None

    def url(self, database: str) -> str:
        """As a person gives it to ``--database``."""
        return f"postgresql://observer@/{database}?host={self.folder}"

    def start(self) -> None:
        """Returns when it answers."""
        command = [str(self.bin / "postgres"), "-D", str(self.folder / "data")]
        command += ["-k", str(self.folder)]
        for each in _FORGETFUL:
            command += ["-c", each]
        log = (self.folder / "log").open("ab")
        with log:
            # What runs between fork and exec makes system calls only, so threads do no harm.
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
        """At once: nobody needs what it holds."""
        if self.process is not None and self.process.poll() is None:
            self.process.send_signal(signal.SIGQUIT)
            try:
                self.process.wait(10)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()

    def run(self, statement: str, database: str = "postgres") -> str:
        """One statement by psql; what it prints without any decoration."""
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
    """A new one, gone in the end with all it held.

    Raises:
        CannotStart: there is none on this machine, or nobody to run it as.
    """
    bin = _programmes()
    user = _user()
    # Not below pytest's folder, which is this user's alone; a socket's path must be short as well.
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
    """Debian keeps them apart from the path, by version."""
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
    """PostgreSQL refuses to be run by root; empty where we are somebody else."""
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
    """A killed test leaves no server behind: Linux ends it with its parent."""
    prctl = getattr(ctypes.CDLL(None), "prctl", None)

    def prepare() -> None:
        if user:
            os.setgroups([])
            os.setgid(user["group"])
            os.setuid(user["user"])
        # Behind the change of user, which takes it back.
        if prctl is not None:
            prctl(_PR_SET_PDEATHSIG, signal.SIGQUIT, 0, 0, 0)

    return prepare
