"""Scripted cameras for tests of normal delivery and of faults."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from observer.sources.cameras.source import CameraSource

from .scripted_camera import OPENER, scripted_spec, write_script
from .watching import Watch, grabbers


@pytest.fixture(autouse=True)
def _found_by_the_cameras_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a camera's process import ``scripted_camera``."""
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=os.pathsep)


@pytest.fixture
def left(tmp_path: Path) -> Path:
    write_script(tmp_path / "left")
    return tmp_path / "left"


@pytest.fixture
def right(tmp_path: Path) -> Path:
    write_script(tmp_path / "right", phase=0.2)
    return tmp_path / "right"


@pytest.fixture
def watch(left: Path, right: Path) -> Iterator[Watch]:
    source = CameraSource(scripted_spec(left, right), opener=OPENER)
    yield Watch(source)
    source.close()
    assert grabbers() == []
