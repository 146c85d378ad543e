"""An engine and a drive process in the test's own process, and a database."""

from __future__ import annotations

import os
import shutil
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path

import pytest

from app.contract.drive import SHARED_NAMES
from app.runtime.latest import create_slot
from app.server import Server
from app.storage import Storage

from .engine_values import rectified_calibration
from .fake_drive import FakeDrive
from .peer_engine import PeerEngine
from .server.servers import started


@pytest.fixture
def peer() -> PeerEngine:
    return PeerEngine()


@pytest.fixture
def drive() -> FakeDrive:
    return FakeDrive()


@pytest.fixture
async def server(peer: PeerEngine, storage: Storage) -> AsyncIterator[Server]:
    """A server that observes the simulated lab, without a drive process."""
    async with started(peer, storage) as server:
        yield server


@pytest.fixture
def slots() -> Iterator[dict[str, int]]:
    """The shared memory slots of engine and drive process."""
    slots = {name: create_slot(256 * 1024) for name in SHARED_NAMES}
    yield slots
    for fd in slots.values():
        os.close(fd)


@pytest.fixture
def calibration_yaml() -> Callable[..., str]:
    return rectified_calibration


@pytest.fixture(scope="session")
def migrated_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An empty database of this version: making one takes longer than most tests."""
    file = tmp_path_factory.mktemp("template") / "observer.sqlite"
    with Storage(file):
        pass
    return file


@pytest.fixture
def storage(tmp_path: Path, migrated_file: Path) -> Iterator[Storage]:
    shutil.copy(migrated_file, tmp_path / "observer.sqlite")
    storage = Storage(tmp_path / "observer.sqlite", busy_timeout_s=0.5)
    yield storage
    storage.close()
