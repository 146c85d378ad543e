"""``make`` sets up a fresh clone, and a wheel serves the panel from what that installed.

One environment for both: installing everything takes longer than all the checks.
"""

from __future__ import annotations

import http.client
import re
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from .making import make

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


@pytest.fixture(scope="module")
def set_up(clone_into: Callable[[Path], None], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fresh clone in which ``make setup`` has run."""
    clone = tmp_path_factory.mktemp("set-up") / "fresh clone"
    clone_into(clone)
    started = time.monotonic()
    done = make(clone, "setup", timeout=540)
    assert done.returncode == 0, done.stderr
    print(f"set-up of a fresh clone: {time.monotonic() - started:.1f} s")  # noqa: T201
    return clone


@pytest.fixture(scope="module")
def wheel(clone_into: Callable[[Path], None], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel, built once from the files as they are now."""
    folder = tmp_path_factory.mktemp("wheel")
    clone = folder / "fresh clone"
    clone_into(clone)
    # As in `make wheel`: the build includes the documentation that is built here.
    subprocess.run([sys.executable, "-m", "tools.docs"], cwd=clone, check=True, timeout=100)
    done = subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--outdir", str(folder / "dist"), str(clone)],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    (made,) = (folder / "dist").glob("*.whl")
    return made


@pytest.mark.patient
def test_a_fresh_clone_is_set_up_once(set_up: Path) -> None:
    assert (set_up / "static" / "vendor" / "uplot" / "uPlot.esm.js").is_file()
    assert (set_up / "docs" / "site" / "index.html").is_file()
    assert not list((set_up / ".venv" / "lib").glob("python3.*/site-packages/app"))
    where = subprocess.run(
        [set_up / ".venv" / "bin" / "python", "-c", "import app; print(app.__file__)"],
        cwd=set_up.parent,
        check=True,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert where.stdout.strip() == str(set_up / "app" / "__init__.py")
    second = make(set_up, "setup")
    assert (second.returncode, second.stdout) == (0, "")


def test_the_wheel_contains_the_package_and_nothing_else(wheel: Path, repository: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    for name in (
        "app/static/index.html",
        "app/static/vendor/uplot/uPlot.esm.js",
        "app/static/vendor/uplot/uPlot.min.css",
        "app/static/vendor/uplot/LICENSE.txt",
        "app/static/vendor/swagger-ui/swagger-ui-bundle.js",
        "app/static/vendor/swagger-ui/swagger-ui.css",
        "app/static/vendor/swagger-ui/LICENSE.txt",
        "app/help/index.html",
        "app/help/parameters.html",
        "app/help/search/search_index.json",
        "app/storage/migrations/env.py",
        "app/storage/migrations/versions/0001_runs_and_parameters.py",
    ):
        assert name in names
    for source in (repository / "static" / "app").rglob("*.js"):
        assert f"app/static/{source.relative_to(repository / 'static').as_posix()}" in names
    for package in ("app", "observer"):
        for source in (repository / package).rglob("*.py"):
            name = source.relative_to(repository).as_posix()
            assert name in names
    unwanted = re.compile(
        r"node_modules|package(-lock)?\.json|tsconfig|\.d\.ts$|/\.|^tests|^tools|\.pyc$"
    )
    assert [name for name in names if unwanted.search(name)] == []


@pytest.mark.patient
def test_the_wheel_serves_with_only_its_dependencies_installed(
    wheel: Path, set_up: Path, tmp_path: Path, free_port: int
) -> None:
    environment = set_up / ".venv"
    pip = [str(environment / "bin" / "python"), "-m", "pip", "--disable-pip-version-check"]
    subprocess.run([*pip, "uninstall", "-q", "-y", "dynamic-observer"], check=True, timeout=60)
    # Without an index it fails if any of its dependencies is missing.
    install = [*pip, "install", "-q", "--no-compile", "--no-index", str(wheel)]
    subprocess.run(install, check=True, timeout=60)
    (installed,) = (environment / "lib").glob("python3.*/site-packages/app")
    assert (installed / "static" / "vendor").is_dir()
    assert (installed / "help").is_dir()

    log = tmp_path / "serve.log"
    command = [str(environment / "bin" / "dynamic-observer"), "serve"]
    command += ["--port", str(free_port), "--data", str(tmp_path / "data")]
    with log.open("wb") as output:
        server = subprocess.Popen(command, cwd=tmp_path, stdout=output, stderr=subprocess.STDOUT)
    try:
        token = wait_for_token(server, log)
        for path, content in (
            ("/", "html"),
            ("/static/app/main.js", "javascript"),
            ("/static/vendor/uplot/uPlot.esm.js", "javascript"),
            ("/static/vendor/swagger-ui/swagger-ui.css", "css"),
            ("/help/", "html"),
            ("/help/search/search_index.json", "json"),
        ):
            status, kind = get(free_port, path, token)
            assert (status, content in kind) == (200, True), f"{path}: {status} {kind}"
    finally:
        server.terminate()
        server.wait(timeout=20)
    assert (tmp_path / "data").is_dir()


@pytest.mark.patient
def test_clean_removes_everything_that_setup_made(set_up: Path) -> None:
    assert make(set_up, "clean").returncode == 0
    assert not (set_up / ".venv").exists()
    assert not (set_up / "static" / "vendor").exists()
    assert not (set_up / "docs" / "site").exists()


def wait_for_token(server: subprocess.Popen[bytes], log: Path) -> str:
    """Return the token in the link that the server prints once it can be reached."""
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        found = re.search(r"\?token=([\w-]+)", log.read_text())
        if found:
            return found.group(1)
        assert server.poll() is None, log.read_text()
        time.sleep(0.1)
    raise AssertionError(f"no link within 60 s: {log.read_text()}")


def get(port: int, path: str, token: str) -> tuple[int, str]:
    deadline = time.monotonic() + 30
    while True:
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
        try:
            connection.request("GET", path, headers={"Authorization": f"Bearer {token}"})
            answer = connection.getresponse()
            answer.read()
            return answer.status, answer.headers.get("Content-Type", "")
        except ConnectionRefusedError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.2)
        finally:
            connection.close()
