"""MATLAB's stereo parameters: structs and objects, and every MATLAB peculiarity."""

from __future__ import annotations

import contextlib
import io
import sys
import warnings
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.calibration.formats import matlab_container
from observer.calibration.formats.recognition import read_any
from observer.calibration.formats.understanding import NamedFile, UnderstoodCalibration
from observer.errors import CalibrationError

R = cv2.Rodrigues(np.array([0.02, -0.03, 0.01]))[0]
K1 = np.array([[500.0, 0, 320], [0, 501, 240], [0, 0, 1]])
K2 = np.array([[499.0, 0, 318], [0, 500, 241], [0, 0, 1]])


def one_based(K: np.ndarray) -> np.ndarray:
    """MATLAB's camera matrix: transposed, with pixels counted from 1."""
    return (K + np.array([[0, 0, 1], [0, 0, 1], [0, 0, 0]])).T


def camera(K: np.ndarray, /, **changes: object) -> dict[str, object]:
    fields: dict[str, object] = {
        "IntrinsicMatrix": one_based(K),
        "RadialDistortion": np.array([[-0.25, 0.08]]),
        "TangentialDistortion": np.array([[0.001, -0.002]]),
        "ImageSize": np.array([[480.0, 640.0]]),
        "WorldUnits": "millimeters",
        "EstimateSkew": False,
        "ReprojectionErrors": np.zeros((5, 2, 3)),
        "Version": {"Major": 9.0, "Minor": 2.0},
    }
    return {key: value for key, value in (fields | changes).items() if value is not None}


def parameters(**changes: object) -> dict[str, object]:
    fields: dict[str, object] = {
        "CameraParameters1": camera(K1),
        "CameraParameters2": camera(K2),
        "RotationOfCamera2": R.T,
        "TranslationOfCamera2": np.array([[-120.0, 3.0, -2.0]]),
    }
    return {key: value for key, value in (fields | changes).items() if value is not None}


def saved(value: object, *, compressed: bool = True, **further: object) -> bytes:
    # SciPy's stubs accept only paths.
    file: Any = io.BytesIO()
    scipy.io.savemat(
        file, {"stereoParams": value, **further}, do_compression=compressed, oned_as="row"
    )
    return bytes(file.getvalue())


def saved_object(
    folder: Path, values: dict[str, Any], class_name: str, version: str, *, compressed: bool = True
) -> bytes:
    """Return an object of a class, written by mat-io because MATLAB is not available here."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        matio = pytest.importorskip("matio")
        from matio.utils import MatlabOpaque

        def made(fields: dict[str, Any], name: str) -> Any:
            return MatlabOpaque(properties=fields, classname=name)

        cameras = {
            key: made(value, "cameraParameters") if key.startswith("CameraParameters") else value
            for key, value in values.items()
        }
        path = str(folder / "made.mat")
        matio.save_to_mat(
            path,
            {"stereoParams": made(cameras, class_name)},
            version=version,
            do_compression=compressed,
        )
    return Path(path).read_bytes()


def read(content: bytes, **choices: object) -> UnderstoodCalibration:
    return read_any([NamedFile("stereo.mat", content)], **choices)  # type: ignore[arg-type]


def assert_is_the_rig(understood: UnderstoodCalibration) -> None:
    made = understood.calibration
    assert (made.width, made.height) == (640, 480)
    assert np.allclose(made.K1, K1)
    assert np.allclose(made.K2, K2)
    assert made.D1.tolist() == [-0.25, 0.08, 0.001, -0.002]
    assert np.allclose(made.R, R)
    assert np.allclose(made.T, [-0.12, 0.003, -0.002])


@pytest.mark.parametrize("compressed", [True, False])
def test_struct_is_converted_to_opencv_conventions(compressed: bool) -> None:
    understood = read(saved(parameters(), compressed=compressed, other=np.arange(3)))
    assert_is_the_rig(understood)
    assert understood.format == "MATLAB stereoParameters"
    assert understood.notes == (
        "variable stereoParams: MATLAB counts pixels from 1, so 1 was subtracted from cx and cy",
        "CameraParameters1.IntrinsicMatrix was transposed from MATLAB's convention",
        "CameraParameters2.IntrinsicMatrix was transposed from MATLAB's convention",
        "RotationOfCamera2 was transposed from MATLAB's convention",
        "T converted from millimetres: baseline 0.12005 m",
    )


def test_object_is_read_by_mat_io(tmp_path: Path) -> None:
    assert_is_the_rig(read(saved_object(tmp_path, parameters(), "stereoParameters", "v7")))


def test_objects_storing_fields_beside_a_version_are_read(tmp_path: Path) -> None:
    version = {"Name": "Computer Vision System Toolbox", "Release": "(R2017a)"}
    cameras = {
        f"CameraParameters{i}": {"Version": version, "any": camera(K)}
        for i, K in ((1, K1), (2, K2))
    }
    kept = {"Version": version, "any": parameters(**cameras)}
    assert_is_the_rig(read(saved_object(tmp_path, kept, "stereoParameters", "v7")))


def test_objects_written_by_matlab_are_read(shared_data: Path) -> None:
    folder = shared_data / "wild" / "calibrations"
    for letter, baseline, focal in (("a", 0.0728, 825), ("b", 0.0714, 828)):
        content = (folder / f"matlab_object_{letter}.mat").read_bytes()
        made = read(content, size=(640, 480)).calibration
        assert made.baseline == pytest.approx(baseline, abs=1e-4)
        assert made.K1[0, 0] == pytest.approx(focal, abs=1)


def test_a_busy_computer_is_not_blamed_on_the_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(matlab_container, "_PATIENCE_S", 0.01)
    with pytest.raises(CalibrationError, match=r"was not read within .* too busy; try again"):
        read(saved(parameters()))


def test_newer_matrices_are_not_transposed() -> None:
    cameras = {
        f"CameraParameters{i}": camera(K, IntrinsicMatrix=None, K=one_based(K).T)
        for i, K in ((1, K1), (2, K2))
    }
    pose = {"R": R, "Translation": np.array([[-120.0, 3.0, -2.0]])}
    newer = parameters(
        **cameras, RotationOfCamera2=None, TranslationOfCamera2=None, PoseCamera2=pose
    )
    assert_is_the_rig(read(saved(newer)))
    A = np.eye(4)
    A[:3, :3], A[:3, 3] = R, [-120, 3, -2]
    assert_is_the_rig(read(saved(newer | {"PoseCamera2": {"A": A}})))


def test_three_radial_coefficients_are_reordered_for_opencv() -> None:
    three = camera(K1, RadialDistortion=np.array([[-0.25, 0.08, 0.02]]))
    made = read(saved(parameters(CameraParameters1=three))).calibration
    # OpenCV puts the tangential ones in between.
    assert made.D1.tolist() == [-0.25, 0.08, 0.001, -0.002, 0.02]


@pytest.mark.parametrize(
    ("units", "unit", "factor"),
    [("meters", None, 1.0), ("cm", None, 0.01), ("millimeters", "cm", 0.01), (None, None, 0.001)],
)
def test_world_units_scale_the_baseline(units: str | None, unit: str | None, factor: float) -> None:
    translation = np.array([[-0.12 / factor, 0, 0]])
    value = parameters(CameraParameters1=camera(K1, WorldUnits=units),
                       TranslationOfCamera2=translation)  # fmt: skip
    understood = read(saved(value), unit=unit)
    assert understood.calibration.baseline == pytest.approx(0.12)
    note = "WorldUnits is not set; millimetres, MATLAB's default, are assumed"
    assert (note in understood.notes) == (units is None)


def test_empty_image_size_must_be_supplied() -> None:
    empty = np.zeros((0, 0))
    value = parameters(CameraParameters1=camera(K1, ImageSize=empty),
                       CameraParameters2=camera(K2, ImageSize=empty))  # fmt: skip
    with pytest.raises(CalibrationError, match=r"CameraParameters1\.ImageSize is missing or empty"):
        read(saved(value))
    understood = read(saved(value), size=(640, 480))
    assert_is_the_rig(understood)
    assert "ImageSize is empty; 640x480 is assumed" in understood.notes


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"CameraParameters2": None}, "CameraParameters2 is missing or not a struct"),
        ({"RotationOfCamera2": None}, "RotationOfCamera2 is missing"),
        ({"RotationOfCamera2": 2 * R}, "R must be a rotation matrix"),
        ({"RotationOfCamera2": R[:2]}, "RotationOfCamera2 must contain 9 numbers, not 6"),
        ({"TranslationOfCamera2": np.zeros((1, 3))}, "T must not be zero"),
        ({"TranslationOfCamera2": np.array([[120.0, 0, 0]])}, "swap left and right"),
        ({"TranslationOfCamera2": np.array([[-0.12, 0, 0]])}, "in metres (120 mm), set unit='m'"),
        ({"TranslationOfCamera2": np.array([[np.nan, 0, 0]])}, "contain finite numbers only"),
        ({"TranslationOfCamera2": "left"}, "TranslationOfCamera2 must contain numbers"),
        ({"CameraParameters1": camera(K1, WorldUnits="furlongs")}, "WorldUnits is 'furlongs'"),
        ({"CameraParameters1": camera(K1, ImageSize=np.array([[960, 1280]]))},
         "CameraParameters2.ImageSize is 640x480, but the left camera's is 1280x960"),
        ({"CameraParameters1": camera(K1, ImageSize=np.array([[480.5, 640]]))}, "ImageSize must"),
        ({"CameraParameters1": camera(K1, RadialDistortion=np.zeros((1, 4)))},
         "CameraParameters1.RadialDistortion must contain 2 or 3 numbers, not 4"),
        ({"CameraParameters1": camera(K1, TangentialDistortion=None)},
         "CameraParameters1.TangentialDistortion is missing"),
        ({"CameraParameters1": camera(np.array([[500.0, 3, 320], [0, 501, 240], [0, 0, 1]]))},
         "CameraParameters1.IntrinsicMatrix has a skew of 3, which shifts pixels by up to 1.4 px"),
    ],
)  # fmt: skip
def test_refuses(changes: dict[str, object], expected: str) -> None:
    with pytest.raises(CalibrationError) as caught:
        read(saved(parameters(**changes)))
    assert str(caught.value).startswith("stereo.mat: ")
    assert expected in str(caught.value)


def test_refuses_an_object_without_mat_io_and_explains_the_alternatives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = saved_object(tmp_path, parameters(), "stereoParameters", "v7")
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    for module in [name for name in sys.modules if name.partition(".")[0] == "matio"]:
        monkeypatch.delitem(sys.modules, module)
    with pytest.raises(CalibrationError) as caught:
        read(content)
    assert "pip install 'dynamic-observer[matlab]'" in str(caught.value)
    assert "stereoParams = toStruct(stereoParams)" in str(caught.value)


def test_refuses_files_with_other_content(tmp_path: Path) -> None:
    hdf = saved_object(tmp_path, parameters(), "stereoParameters", "v7.3")
    other = saved_object(tmp_path, parameters(), "cameraParameters", "v7")
    two = saved(parameters(), again=parameters())
    for content, expected in (
        (
            hdf,
            r"version 7\.3 MAT-file \(HDF5\), which is not supported; in MATLAB: stereoParams =",
        ),
        (other, r"holds no stereoParameters \(it has stereoParams\); save exactly one"),
        (saved(np.eye(3)), r"holds no stereoParameters \(it has stereoParams\)"),
        (two, r"holds more than one stereoParameters \(it has again, stereoParams\)"),
        (saved(parameters())[:100], "truncated or damaged in its header"),
        (saved(parameters())[:-40], "truncated or damaged"),
        (hdf[512:], "which is not supported"),
    ):
        with pytest.raises(CalibrationError, match=rf"^stereo\.mat: .*{expected}"):
            read(content)


def test_refuses_decompression_bombs() -> None:
    head = saved(1.0)[:128]
    packed = zlib.compress(bytes(40_000_000), 9)
    bomb = head + np.array([15, len(packed)], "<u4").tobytes() + packed
    assert len(bomb) < 100_000
    with pytest.raises(CalibrationError, match="larger than 16000000 bytes when decompressed"):
        read(bomb)


def test_refuses_arrays_that_claim_more_than_the_file_holds() -> None:
    whole = saved(parameters(), compressed=False)
    # The dimensions of the struct itself: 1 x 1.
    at = whole.index(np.array([1, 1], "<i4").tobytes(), 128)
    claims = whole[:at] + np.array([1 << 30, 1 << 30], "<i4").tobytes() + whole[at + 8 :]
    with pytest.raises(CalibrationError, match="does not match its number of elements"):
        read(claims)


WHOLE = saved(parameters(), compressed=False)


# Each example starts a process.
@pytest.mark.parametrize(
    "examples", [25, pytest.param(400, marks=[pytest.mark.patient, pytest.mark.timeout(900)])]
)
def test_damaged_file_is_read_or_refused(examples: int) -> None:
    @given(at=st.integers(0, len(WHOLE) - 1), length=st.integers(0, 12), put=st.binary(max_size=12))
    @settings(max_examples=examples)
    def held(at: int, length: int, put: bytes) -> None:
        damaged = WHOLE[:at] + put + WHOLE[at + length :]
        with contextlib.suppress(CalibrationError):
            read(damaged)

    held()


@given(st.binary(max_size=200))
@settings(max_examples=200)
def test_arbitrary_bytes_after_a_header_are_refused(content: bytes) -> None:
    with pytest.raises(CalibrationError):
        read(WHOLE[:128] + content)


def test_crash_while_reading_damaged_objects_is_contained(tmp_path: Path) -> None:
    whole = saved_object(tmp_path, parameters(), "stereoParameters", "v7", compressed=False)
    at = whole.index(b"FileWrapper__")
    refusals: list[int] = []
    # Single-byte changes that crash the process of mat-io 1.0.2 with a signal.
    for offset, byte in ((1065, 255), (2785, 127)):
        damaged = bytearray(whole)
        damaged[at + offset] = byte
        with contextlib.suppress(CalibrationError):
            read(bytes(damaged))
            continue
        refusals.append(offset)
    assert refusals


@pytest.mark.parametrize("at", [128, 300])
def test_truncated_objects_are_refused(at: int, tmp_path: Path) -> None:
    whole = saved_object(tmp_path, parameters(), "stereoParameters", "v7")
    with pytest.raises(CalibrationError, match=r"no stereoParameters|truncated or damaged"):
        read(whole[:at])
