from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from app.storage import RunRecord, Storage


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "observer.sqlite"


@pytest.fixture
def storage(file: Path) -> Iterator[Storage]:
    with Storage(file) as opened:
        yield opened


@pytest.fixture
def run(storage: Storage) -> RunRecord:
    return storage.create_run(
        name="first",
        source="simulated:lab",
        parameters={"ego_motion.model": "affine"},
        versions={"dynamic-observer": "0.1.0"},
        preset="paper",
    )
