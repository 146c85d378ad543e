"""Damaged calibrations of every format give a valid calibration or a one-line refusal."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.calibration.formats.exporting import ExportKind, export_calibration
from observer.calibration.formats.recognition import named_file, read_any
from observer.calibration.formats.understanding import NamedFile
from observer.calibration.formats.units import parse_unit
from observer.camera import StereoCalibration
from observer.errors import CalibrationError

from ....damage import damaged, examples, hostile_bytes, hostile_text, read_or_refused
from . import test_matlab_file, test_oak_file, test_ost_file
from .test_recognition import FORMATS, RIG

SAMPLES: dict[str, tuple[bytes, ...]] = {
    **{name: tuple(file.content for file in files) for name, files in FORMATS.items()},
    "OAK": (json.dumps(test_oak_file.board(), indent=1).encode(),),
    "ost.txt of two": (test_ost_file.LEFT.encode(), test_ost_file.RIGHT.encode()),
    "ost.txt of one": ((test_ost_file.LEFT + test_ost_file.RIGHT).encode(),),
}
PIECES = tuple(
    key.encode() + mark
    for key in ("K1", "D1", "T", "cam0", "cameraData", "T_BS", "camera_matrix", "P0", "S_00",
                "image_width", "distortion_model", "T_cn_cnm1", "toCameraSocket", "resolution")
    for mark in (b": ", b": 1\n", b"=[")
)  # fmt: skip


def hold(contents: list[bytes], size: tuple[int, int] | None = None) -> None:
    """Read the files and check that they are refused or give a usable calibration."""
    files = [NamedFile(f"file{i}", content) for i, content in enumerate(contents)]
    understood = read_or_refused(lambda: read_any(files, size=size), CalibrationError)
    if understood is not None:
        assert_usable(understood.calibration)
        assert all(len(note.splitlines()) == 1 for note in understood.notes)


def assert_usable(made: StereoCalibration) -> None:
    for each in dataclasses.fields(made):
        value = getattr(made, each.name)
        assert not isinstance(value, np.ndarray) or np.isfinite(value).all(), each.name
    np.testing.assert_allclose(made.R @ made.R.T, np.eye(3), atol=1e-5)
    assert np.linalg.det(made.R) == pytest.approx(1, abs=1e-5)
    assert 0.001 <= made.baseline <= 2
    assert 8 <= min(made.width, made.height) <= max(made.width, made.height) <= 16384
    assert min(made.K1[0, 0], made.K1[1, 1], made.K2[0, 0], made.K2[1, 1]) > 0


@pytest.mark.parametrize("format", SAMPLES)
@examples(16)
@given(data=st.data())
def test_damaged_files_are_refused_or_give_a_valid_calibration(
    format: str, data: st.DataObject
) -> None:
    contents = list(SAMPLES[format])
    which = data.draw(st.integers(0, len(contents) - 1))
    contents[which] = data.draw(damaged([contents[which]], PIECES))
    hold(contents, data.draw(st.sampled_from([None, (1241, 376)])))


# Values that a MAT-file may hold in place of a number, a matrix, text or a struct.
MATLAB_VALUES: tuple[object, ...] = (
    np.nan, np.inf, 0.0, -1.0, 1e308, 5e-324, 1e18, 1 + 2j, True, "", "x", "1 2 3",
    np.zeros((0, 0)), np.zeros((3, 3)), np.full((3, 3), np.nan), np.full((1, 3), 1e308),
    np.zeros((1, 2, 3)), np.ones((1, 5000)), np.array([["a", 1.0]], dtype=object), {},
    {"K": {"K": {}}},
    {"CameraParameters1": 1.0}, np.array([[1, 2]], np.int8),
    np.array([[2**64 - 1, 1]], np.uint64),
)  # fmt: skip


@pytest.fixture(scope="module")
def mat_files(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, ...]:
    """The same parameters as a struct, compressed and uncompressed, and as an object."""
    whole = test_matlab_file.parameters()
    folder = tmp_path_factory.mktemp("matlab")
    made = test_matlab_file.saved_object(folder, whole, "stereoParameters", "v7", compressed=False)
    return test_matlab_file.saved(whole), test_matlab_file.saved(whole, compressed=False), made


@st.composite
def changed_parameters(draw: st.DrawFn) -> bytes:
    """An intact MAT-file with one or two values replaced."""
    whole = test_matlab_file.parameters()
    for _ in range(draw(st.integers(1, 2))):
        key = draw(st.sampled_from(sorted(whole)))
        holder, value = whole, draw(st.sampled_from(MATLAB_VALUES))
        within = whole[key]
        if isinstance(within, dict) and draw(st.booleans()):
            holder = within
            key = draw(st.sampled_from(sorted(holder)))
        holder[key] = value
    return test_matlab_file.saved(whole, compressed=draw(st.booleans()))


# Each example starts a process that takes a second.
@pytest.mark.timeout(7200)
@examples(8)
@given(data=st.data())
def test_damaged_mat_file_is_refused_or_gives_a_valid_calibration(
    mat_files: tuple[bytes, ...], data: st.DataObject
) -> None:
    content = data.draw(damaged(mat_files) | changed_parameters())
    hold([content], data.draw(st.sampled_from([None, (640, 480)])))


@examples(40)
@given(contents=st.lists(hostile_bytes(PIECES), min_size=1, max_size=2))
def test_hostile_bytes_are_refused_or_give_a_valid_calibration(contents: list[bytes]) -> None:
    hold(contents)


@pytest.mark.parametrize("names", [
    ("ros_ost.txt",), ("opencv_millimetres/intrinsics.yml", "opencv_millimetres/extrinsics.yml"),
])  # fmt: skip
@examples(12)
@given(data=st.data())
def test_damaged_third_party_files_are_refused_or_valid(
    shared_data: Path, names: tuple[str, ...], data: st.DataObject
) -> None:
    folder = shared_data / "wild" / "calibrations"
    if not folder.is_dir():
        pytest.skip(f"the third-party calibrations are missing: {folder} is not a folder")
    contents = [named_file(folder / name).content for name in names]
    which = data.draw(st.integers(0, len(contents) - 1))
    contents[which] = data.draw(damaged([contents[which]], PIECES))
    hold(contents, data.draw(st.sampled_from([None, (640, 480)])))


_small = st.floats(-0.2, 0.2)


@st.composite
def rigs(draw: st.DrawFn) -> StereoCalibration:
    """Any calibration that all three tools can represent."""
    K1, K2 = (
        np.array([[draw(st.floats(450, 550)), 0, draw(st.floats(280, 360))],
                  [0, draw(st.floats(450, 550)), draw(st.floats(200, 280))], [0, 0, 1]])
        for _ in range(2)
    )  # fmt: skip
    # Four coefficients, kept small: large ones fold the image over within its border.
    D1, D2 = (np.array([draw(_small) * scale for scale in (1, 0.1, 0.01, 0.01)]) for _ in range(2))
    return dataclasses.replace(RIG, K1=K1, D1=D1, K2=K2, D2=D2,
                               T=np.array([-draw(st.floats(0.02, 1.5)), 0.001, 0.002]))  # fmt: skip


@pytest.mark.parametrize(("kind", "atol"), [("opencv", 0.0), ("kalibr", 0.0), ("ros", 1e-6)])
@examples(10)
@given(made=rigs())
def test_exported_calibration_is_read_back_unchanged(
    kind: ExportKind, atol: float, made: StereoCalibration
) -> None:
    read = read_any(export_calibration(made, kind, "a")).calibration
    for key in ("K1", "K2", "R", "T"):
        np.testing.assert_allclose(getattr(read, key), getattr(made, key), atol=atol, rtol=0)
    for key in ("D1", "D2"):
        # ROS pads to five coefficients.
        np.testing.assert_array_equal(getattr(read, key)[:4], getattr(made, key))
        assert not getattr(read, key)[4:].any()


@examples(40)
@given(text=hostile_text(("25", "mm", "25mm", "in", "1e3", " m ")))
def test_any_unit_text_is_parsed_or_refused(text: str) -> None:
    unit = read_or_refused(lambda: parse_unit(text), CalibrationError)
    assert unit is None or isinstance(unit, str) or 0 < unit < 1e10
