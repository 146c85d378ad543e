"""Databases of both kinds: what holds for one must hold for the other."""

from __future__ import annotations

import itertools
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from app.storage import RunRecord, Storage

from ...postgresql import CannotStart, PrivateServer, private_server
from .backups import back_up, fill

_TEMPLATE = "migrated"
_numbers = itertools.count()


@pytest.fixture(scope="session")
def server_or_reason(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PrivateServer | str]:
    """One server for all tests of this process, or the reason why there is none."""
    try:
        with private_server() as server:
            server.run(f"CREATE DATABASE {_TEMPLATE}")
            with Storage(server.url(_TEMPLATE), folder=tmp_path_factory.mktemp("template")):
                pass
            yield server
    except CannotStart as error:
        yield str(error)


@pytest.fixture
def server(server_or_reason: PrivateServer | str) -> PrivateServer:
    """The server; without it tests are skipped, except in CI, where they fail."""
    if isinstance(server_or_reason, str):
        if os.environ.get("CI"):
            pytest.fail(server_or_reason)
        pytest.skip(server_or_reason)
    return server_or_reason


@pytest.fixture
def new_database(server: PrivateServer) -> Iterator[Callable[[], str]]:
    """Makes an empty database on the server and gives its URL."""
    made: list[str] = []

    def make(template: str = "template1") -> str:
        made.append(f"test_{next(_numbers)}")
        server.run(f"CREATE DATABASE {made[-1]} TEMPLATE {template}")
        return server.url(made[-1])

    yield make
    for name in made:
        server.run(f"DROP DATABASE {name} WITH (FORCE)")


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "observer.sqlite"


@pytest.fixture(params=["sqlite", "postgresql"])
def location(
    request: pytest.FixtureRequest,
    file: Path,
    migrated_file: Path,
    server_or_reason: PrivateServer | str,
) -> str | Path:
    """A database of each kind. The server starts first, so that the test does not own it."""
    del server_or_reason
    if request.param == "sqlite":
        shutil.copyfile(migrated_file, file)
        return file
    make: Callable[[str], str] = request.getfixturevalue("new_database")
    return make(_TEMPLATE)


@pytest.fixture
def opened(location: str | Path, tmp_path: Path) -> Callable[[], Storage]:
    """``with opened() as storage``: open the test's own database, as often as needed."""
    return lambda: Storage(location, folder=tmp_path, busy_timeout_s=1.0).open()


@pytest.fixture
def storage(opened: Callable[[], Storage]) -> Iterator[Storage]:
    with opened() as storage:
        yield storage


@pytest.fixture
def run(storage: Storage) -> RunRecord:
    return storage.create_run(
        name="first",
        source="simulated:lab",
        parameters={"ego_motion.model": "affine"},
        versions={"dynamic-observer": "0.1.0"},
        preset="paper",
    )


@pytest.fixture(scope="module")
def kept_once(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    folder = tmp_path_factory.mktemp("kept")
    data = folder / "first"
    with Storage(data / "observer.sqlite") as storage:
        run_id = fill(storage)
        back_up(storage, data / "observer.sqlite", folder / "kept.zip")
    return folder, run_id


@pytest.fixture
def kept(kept_once: tuple[Path, str], tmp_path: Path) -> tuple[Path, str]:
    """A backup of the data folder ``first`` beside it, recordings included, and its run."""
    folder, run_id = kept_once
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    return tmp_path / "kept.zip", run_id
