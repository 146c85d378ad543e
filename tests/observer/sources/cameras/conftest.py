"""Cameras that follow a script, for the tests of what they deliver and of their faults."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from observer.sources.cameras.source import CameraSource

from .scripted_camera import OPENER, scripted_spec, write_script
from .watching import Watch, grabbers


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
