"""Damaged truth files of every kind: what is read is finite and in order, or a one-line refusal
says why not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.errors import TruthError
from observer.truth.files.recognition import file_kind, read_capture
from observer.truth.motion_capture import Capture

from ....damage import damaged, examples, hostile_bytes, read_or_refused
from .test_c3d_file import WHOLE as C3D
from .test_recognition import FILES, PIECES

MEANT = tuple(piece.encode() for piece in PIECES)
# Bytes: only the head, because the files are large and damage inside a table is all alike.
WILD_BYTES = 6000


def hold(path: Path, content: bytes, rate_hz: float | None = 100.0) -> None:
    """Read the file, and check that the result is valid motion capture."""
    path.write_bytes(content)
    read_or_refused(lambda: file_kind(path), TruthError)
    capture = read_or_refused(lambda: read_capture(path, rate_hz=rate_hz), TruthError)
    if capture is not None:
        assert_usable(capture)


def assert_usable(capture: Capture) -> None:
    assert capture.bodies
    assert capture.rate_hz is None or 0 < capture.rate_hz < 1e6
    for name, body in capture.bodies.items():
        assert name == body.name
        assert len(name.splitlines()) == 1
        assert np.isfinite(body.times).all()
        assert (np.diff(body.times) > 0).all()
        assert np.isfinite(body.positions[body.seen]).all()
        if body.rotations is not None:
            turned = body.rotations[np.isfinite(body.rotations).all(axis=(1, 2))]
            np.testing.assert_allclose(
                turned @ np.swapaxes(turned, 1, 2),
                np.tile(np.eye(3), (len(turned), 1, 1)),
                atol=1e-6,
            )
    assert all(len(note.splitlines()) == 1 for note in capture.notes)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("damage") / "upload"


@examples(100)
@given(content=damaged([each.encode() for each in FILES], MEANT))
def test_damaged_text_is_refused_or_valid(place: Path, content: bytes) -> None:
    hold(place, content)


@examples(40)
@given(content=damaged([C3D]), rate_hz=st.sampled_from([None, 100.0]))
def test_damaged_c3d_file_is_refused_or_valid(
    place: Path, content: bytes, rate_hz: float | None
) -> None:
    hold(place, content, rate_hz)


@examples(40)
@given(content=hostile_bytes(MEANT))
def test_hostile_bytes_are_refused_or_valid(place: Path, content: bytes) -> None:
    hold(place, content)


@examples(40)
@given(data=st.data())
def test_damaged_third_party_files_are_refused_or_valid(
    shared_data: Path, place: Path, data: st.DataObject
) -> None:
    folder = shared_data / "wild" / "motion_capture"
    if not folder.is_dir():
        pytest.skip(f"the third-party motion capture is missing: {folder} is not a folder")
    file = data.draw(st.sampled_from(sorted(folder.iterdir())))
    hold(place, data.draw(damaged([file.read_bytes()[:WILD_BYTES]], MEANT)))
