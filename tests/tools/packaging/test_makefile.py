"""A missing prerequisite gives one sentence with the next command."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from .making import make

TOOLS = ("sh", "make", "sed", "cat", "id", "touch", "printf", "rm", "uname", "env", "chmod")


@pytest.fixture
def bare(tmp_path: Path) -> Path:
    """A folder of commands that has a shell and make, but neither Python nor npm."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for tool in TOOLS:
        path = shutil.which(tool)
        assert path is not None, f"{tool} is needed to test the Makefile"
        (folder / tool).symlink_to(path)
    return folder


def sentences(done: subprocess.CompletedProcess[str]) -> list[str]:
    """Return what was written to stderr, without make's own closing line."""
    return [line for line in done.stderr.splitlines() if not line.startswith("make")]


def fake_python(folder: Path, name: str, version: str, answers: str) -> None:
    script = folder / name
    script.write_text(
        f'#!/bin/sh\n[ "$1" = --version ] && {{ echo "Python {version}"; exit 0; }}\n{answers}\n'
    )
    script.chmod(0o755)


def test_a_missing_python_is_reported(clone: Path, bare: Path) -> None:
    done = make(clone, "setup", path=str(bare))
    assert done.returncode != 0
    (sentence,) = sentences(done)
    assert "Python 3.11 or newer is needed, but no Python was found" in sentence
    assert "apt-get install python3.11" in sentence
    assert not (clone / ".venv").exists()


def test_an_old_python_is_reported(clone: Path, bare: Path) -> None:
    fake_python(bare, "python3", "3.10.12", "exit 1")
    done = make(clone, "run", path=str(bare))
    assert done.returncode != 0
    (sentence,) = sentences(done)
    assert "Python 3.11 or newer is needed, but Python 3.10.12 was found" in sentence


def test_a_newer_python_beside_an_old_one_is_used(clone: Path, bare: Path) -> None:
    fake_python(bare, "python3", "3.10.12", "exit 1")
    fake_python(bare, "python3.12", "3.12.1", 'echo "asked: $*"; exit 0')
    done = make(clone, ".venv/.made", path=str(bare))
    assert "asked: -m venv .venv" in done.stdout


def test_a_python_without_venv_is_reported(clone: Path, bare: Path) -> None:
    answers = 'case "$2" in *ensurepip*) exit 1;; *print*) echo python3.12;; esac'
    fake_python(bare, "python3", "3.12.1", answers)
    done = make(clone, "test", path=str(bare))
    assert done.returncode != 0
    (sentence,) = sentences(done)
    assert "lacks the module venv" in sentence
    assert "apt-get install python3.12-venv" in sentence


def test_a_missing_npm_without_pip_is_reported(clone: Path, tmp_path: Path) -> None:
    environment = tmp_path / "venv"
    subprocess.run(
        [sys.executable, "-m", "venv", "--without-pip", str(environment)], check=True, timeout=60
    )
    done = subprocess.run(
        [str(environment / "bin" / "python"), "tools/packaging/frontend.py", "vendor"],
        cwd=clone,
        env={"PATH": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 1
    (sentence,) = done.stderr.splitlines()
    assert "npm 7 or newer is missing" in sentence
    assert "apt-get install npm" in sentence
    assert not (clone / "static" / "vendor").exists()


@pytest.fixture
def database(bare: Path) -> str:
    """Where the Makefile looks for PostgreSQL, as an argument; nothing is there."""
    return f"POSTGRES_HOME={bare}/postgresql"


LEFT_OUT = {
    "chromium": "tests/browser",
    "ffmpeg": "network cameras",
    "postgresql": "the database on PostgreSQL",
}


def test_missing_programs_that_cannot_be_installed_are_reported(
    clone: Path, bare: Path, database: str
) -> None:
    done = make(clone, "system", database, path=str(bare))
    assert done.returncode != 0
    assert len(sentences(done)) == len(LEFT_OUT)
    for sentence, (package, left_out) in zip(sentences(done), LEFT_OUT.items(), strict=True):
        assert f"{left_out} are skipped" in sentence
        assert f"apt-get install {package}" in sentence


def allow_installing(bare: Path, log: Path) -> None:
    """Fake a superuser's apt-get: it creates a program named like the package, and logs calls."""
    install = f'printf "#!/bin/sh\\n" > "{bare}/$4"; chmod +x "{bare}/$4"'
    for name, body in (
        ("apt-get", f'echo "$*" >> "{log}"; [ "$1" = install ] || exit 0; {install}'),
        ("id", "echo 0"),
    ):
        (bare / name).unlink(missing_ok=True)
        (bare / name).write_text(f"#!/bin/sh\n{body}\n")
        (bare / name).chmod(0o755)


def install_server(bare: Path) -> None:
    initdb = bare / "postgresql" / "15" / "bin" / "initdb"
    initdb.parent.mkdir(parents=True)
    initdb.write_text("#!/bin/sh\n")
    initdb.chmod(0o755)


def test_missing_programs_are_installed_if_permitted(
    clone: Path, bare: Path, database: str
) -> None:
    log = clone / "asked"
    asked = ["update -qq", "install -y -qq chromium", "install -y -qq ffmpeg"]
    allow_installing(bare, log)
    install_server(bare)
    done = make(clone, "system", database, path=str(bare))
    assert done.returncode == 0, done.stderr
    assert log.read_text().splitlines() == asked
    assert make(clone, "system", database, path=str(bare)).returncode == 0
    assert log.read_text().splitlines() == asked


def test_a_database_server_is_found_where_debian_installs_it(
    clone: Path, bare: Path, database: str
) -> None:
    done = make(clone, "system", database, path=str(bare))
    assert any("postgresql is missing" in sentence for sentence in sentences(done))
    install_server(bare)
    done = make(clone, "system", database, path=str(bare))
    assert not any("postgresql is missing" in sentence for sentence in sentences(done))


def test_testing_installs_nothing_and_reports_what_is_left_out(
    clone: Path, bare: Path, database: str
) -> None:
    allow_installing(bare, clone / "asked")
    for program in ("pytest", "python"):
        (bare / program).write_text("#!/bin/sh\n")
        (bare / program).chmod(0o755)
    done = make(clone, "test", database, f"BIN={bare}", "-o", "setup-dev", path=str(bare))
    assert done.returncode == 0, done.stderr
    assert not (clone / "asked").exists()
    for sentence, (package, left_out) in zip(sentences(done), LEFT_OUT.items(), strict=True):
        assert f"{package} is missing" in sentence
        assert f"{left_out} are skipped; to run them: make system" in sentence


def test_make_alone_lists_the_targets(clone: Path) -> None:
    done = make(clone)
    assert done.returncode == 0
    for target in (
        "run", "test", "clients-test", "system", "lint", "coverage", "bench", "docs", "wheel",
        "setup", "clean",
    ):  # fmt: skip
        assert f"make {target} " in done.stdout


@pytest.mark.parametrize(("again", "code"), [("0", 0), ("1", 2)])
def test_failed_tests_are_retried_once_in_ci(
    clone: Path, bare: Path, again: str, code: int
) -> None:
    """It is retried automatically, except for promises that must hold every time."""
    log, script = clone / "asked", bare / "pytest"
    script.write_text(
        f'#!/bin/sh\necho "$*" >> "{log}"\n'
        f'case "$*" in *last-failed*) exit {again};; '
        '"-s tests/faults"|tests/observer/kernels) exit 0;; *) exit 1;; esac\n'
    )
    script.chmod(0o755)
    fake_python(bare, "python", "3.12.1", "exit 0")
    done = make(clone, "test", "CI=true", f"BIN={bare}", "-o", "setup-dev", path=str(bare))
    assert done.returncode == code, done.stderr
    asked = log.read_text().splitlines()
    assert asked[1] == "--last-failed --last-failed-no-failures none"
    if code == 0:
        assert [line.split()[-1] for line in asked] == [
            "tests/faults", "none", "tests/observer/kernels", "tests/faults", "tests/browser",
            "none",
        ]  # fmt: skip
