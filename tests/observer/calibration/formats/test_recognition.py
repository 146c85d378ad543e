"""Recognition by content: every format, files that belong together, and shared refusals."""

from __future__ import annotations

import contextlib
import io
import re
import zipfile
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.lib import format as npy

from observer.calibration.formats.exporting import export_calibration
from observer.calibration.formats.recognition import named_file, read_any
from observer.calibration.formats.understanding import Choice, NamedFile, UnderstoodCalibration
from observer.camera import StereoCalibration
from observer.errors import CalibrationError

RIG = StereoCalibration(
    640, 480,
    K1=np.array([[500.0, 0, 320], [0, 501, 240], [0, 0, 1]]), D1=np.array([-0.1, 0.02, 0, 0]),
    K2=np.array([[499.0, 0, 318], [0, 500, 241], [0, 0, 1]]), D2=np.array([-0.2, 0.1, 0, 0]),
    R=np.asarray(cv2.Rodrigues(np.array([0.01, 0.02, -0.03]))[0], np.float64),
    T=np.array([-0.12, 0.001, 0.002]),
)  # fmt: skip


def exported(kind: str) -> tuple[NamedFile, ...]:
    return export_calibration(RIG, kind, "a")  # type: ignore[arg-type]


def row(key: str, values: npt.ArrayLike) -> str:
    return f"{key}: {' '.join(repr(float(v)) for v in np.ravel(values))}\n"


KITTI_RAW = "calib_time: 09-Jan-2012 13:57:47\n" + "".join(
    row(f"S_0{i}", [1392, 512]) + row(f"K_0{i}", [984, 0, 690, 0, 980, 233, 0, 0, 1])
    + row(f"D_0{i}", [-0.3, 0.2, 0, 0, 0]) + row(f"R_0{i}", np.eye(3))
    + row(f"T_0{i}", [0.06 * (i > 1) - 0.5 * (i % 2) - 0.01 * (i == 3), 0, 0])
    + row(f"S_rect_0{i}", [1242, 375]) + row(f"R_rect_0{i}", np.eye(3))
    + row(f"P_rect_0{i}", [700, 0, 600, 45 * (i > 1) - 380 * (i % 2), 0, 700, 170, 0, 0, 0, 1, 0])
    for i in range(4)
)  # fmt: skip
KITTI_ODOMETRY = "".join(
    row(f"P{i}", [700, 0, 600, 45 * (i > 1) - 380 * (i % 2), 0, 700, 180, 0, 0, 0, 1, 0])
    for i in range(4)
)
ZED = "".join(
    f"[{side}_CAM_HD]\nfx=700\nfy=700\ncx=640\ncy=360\nk1=-0.17\nk2=0.03\n"
    for side in ("LEFT", "RIGHT")
) + "[STEREO]\nBaseline=120\nRX_HD=0.001\nCV_HD=0.002\nRZ_HD=0.003\n"  # fmt: skip
MIDDLEBURY = (
    "cam0=[1000 0 300; 0 1000 200; 0 0 1]\ncam1=[1000 0 310; 0 1000 200; 0 0 1]\ndoffs=10\n"
    "baseline=100\nwidth=640\nheight=480\nndisp=64\n"
)
SENSOR = (
    "sensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n"
    "  data: [1, 0, 0, {x}, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\nresolution: [752, 480]\n"
    "camera_model: pinhole\nintrinsics: [458.0, 457.0, 367.0, 248.0]\n"
    "distortion_model: radial-tangential\ndistortion_coefficients: [-0.28, 0.07, 0, 0]\n"
)


def texts(*contents: str) -> tuple[NamedFile, ...]:
    # Uninformative names: formats are recognised by content.
    return tuple(NamedFile(f"file{i}", text.encode()) for i, text in enumerate(contents))


FORMATS: dict[str, tuple[NamedFile, ...]] = {
    "OpenCV FileStorage": exported("opencv"),
    "ROS camera_info of two cameras": exported("ros"),
    "Kalibr camchain": exported("kalibr"),
    "EuRoC sensor.yaml of two cameras": texts(SENSOR.format(x=0), SENSOR.format(x=0.11)),
    "KITTI raw calib_cam_to_cam.txt": texts(KITTI_RAW),
    "KITTI odometry calib.txt": texts(KITTI_ODOMETRY),
    "Middlebury calib.txt": texts(MIDDLEBURY),
    "Stereolabs ZED calibration (.conf)": texts(ZED),
}
SIZES = {"KITTI odometry calib.txt": (1241, 376)}


def read(format: str) -> UnderstoodCalibration:
    return read_any(FORMATS[format], size=SIZES.get(format))


@pytest.mark.parametrize("format", FORMATS)
def test_every_format_is_recognised_and_noted(format: str) -> None:
    understood = read(format)
    assert understood.format == format
    assert understood.notes
    assert re.search(r"baseline 0\.\d+ m$", understood.notes[-1])


@pytest.mark.parametrize("format", FORMATS)
def test_size_differing_from_the_cameras_is_refused(format: str) -> None:
    with pytest.raises(CalibrationError) as caught:
        read_any(FORMATS[format], size=SIZES.get(format), expected_size=(800, 600))
    # ZED and KITTI have no section or images of that size; KITTI odometry was given another.
    assert re.search(
        r"\d+x\d+ images, but the camera delivers 800x600|no section is for "
        r"800x600 images|the images are 800x600 pixels, which matches neither",
        str(caught.value),
    )


def test_kitti_offers_pairs_and_sizes_as_choices() -> None:
    grey = read("KITTI raw calib_cam_to_cam.txt")
    assert grey.choices == (
        Choice("cameras", ("grey", "colour"), "grey"),
        Choice("size", ("1392x512", "1242x375"), "1392x512"),
    )
    assert grey.calibration.baseline == pytest.approx(0.5)
    assert "cameras 0 and 1 (grey) are used" in grey.notes
    raw = FORMATS["KITTI raw calib_cam_to_cam.txt"]
    # The P[3] of both cameras count: 45 / 700 alone is not the baseline.
    colour = read_any(raw, cameras="colour", size=(1242, 375)).calibration
    assert colour.baseline == pytest.approx(380 / 700)
    assert colour.is_rectified
    assert read_any(raw, cameras="colour").calibration.baseline == pytest.approx(0.51)
    only_colour = texts("".join(KITTI_ODOMETRY.splitlines(keepends=True)[2:]))
    assert "cameras 2 and 3 (colour) are used" in read_any(only_colour, size=(1241, 376)).notes


def test_missing_image_size_is_requested() -> None:
    with pytest.raises(CalibrationError, match="does not contain the image size; specify it"):
        read_any(FORMATS["KITTI odometry calib.txt"])
    whole = exported("opencv")[0].content.decode()
    without = texts(re.sub(r"image_\w+: \d+\n", "", whole))
    with pytest.raises(CalibrationError, match="image_width is missing; add image_width and image"):
        read_any(without)
    for option in ({"size": (640, 480)}, {"expected_size": (640, 480)}):
        understood = read_any(without, **option)  # type: ignore[arg-type]
        assert "the file does not contain the image size; 640x480 is assumed" in understood.notes
        assert understood.calibration.width == 640
    with pytest.raises(
        CalibrationError, match=r"K1 has its principal point at \(320, 240\), which"
    ):
        read_any(without, size=(1920, 1080))


def millimetres(text: str) -> str:
    changed = text.replace("[ -0.12, 0.001, 0.002 ]", "[ -120.0, 1.0, 2.0 ]")
    assert changed != text
    return changed


def test_units_are_never_guessed() -> None:
    whole = exported("opencv")[0].content.decode()
    in_mm = texts(millimetres(whole))
    with pytest.raises(CalibrationError, match=r"in millimetres \(120 mm\), set unit='mm'"):
        read_any(in_mm)
    understood = read_any(in_mm, unit="mm")
    assert np.allclose(understood.calibration.T, [-0.12, 0.001, 0.002])
    assert "T converted from millimetres: baseline 0.12002 m" in understood.notes
    in_squares = texts(whole.replace("[ -0.12, 0.001, 0.002 ]", "[ -4.8, 0.0, 0.0 ]"))
    with pytest.raises(CalibrationError, match=r"in squares of a board of 25 mm, set unit='25mm'$"):
        read_any(in_squares)
    understood = read_any(in_squares, unit=0.025)
    assert understood.calibration.baseline == pytest.approx(0.12)
    assert "T converted from units of 25 mm: baseline 0.12 m" in understood.notes
    # Too small in millimetres: the error says that the file is in metres.
    with pytest.raises(
        CalibrationError, match=r"0\.00012.* when read in millimetres, .*is in metres \(120 mm\)"
    ):
        read_any(exported("opencv"), unit="mm")


def archive(**arrays: object) -> NamedFile:
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
    return NamedFile("stereo.npz", file.getvalue())


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig"])
def test_text_of_windows_programs_is_read(encoding: str) -> None:
    file = NamedFile("w.yaml", WHOLE.replace("\n", "\r\n").encode(encoding))
    assert read_any([file]).format == "OpenCV FileStorage"


def test_a_numpy_archive_is_read() -> None:
    """As many Python programs save what OpenCV returns, with its points and views."""
    keys = {key: getattr(RIG, key) for key in ("K1", "D1", "K2", "D2", "R")}
    more = {
        "objpoints": np.ones((20, 54, 3), np.float32),
        "rvecs": np.array([None, "x"], dtype=object),
        "K1": np.asfortranarray(RIG.K1),
        "T": RIG.T.reshape(3, 1),
    }
    understood = read_any([archive(**keys | more, image_size=(640, 480))])
    assert understood.format == "NumPy archive"
    for key in (*keys, "T"):
        np.testing.assert_array_equal(getattr(understood.calibration, key), getattr(RIG, key))
    with pytest.raises(CalibrationError, match="image_width is missing"):
        read_any([archive(**keys | more)])
    assert read_any([archive(**keys | more)], size=(640, 480)).calibration.width == 640


def archive_of(head: bytes) -> NamedFile:
    """An archive with one array that begins so, and much behind it."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as zipped:
        zipped.writestr("K1.npy", head + bytes(1 << 20))
    return NamedFile("big.npz", file.getvalue())


def head_of(*shape: int) -> bytes:
    head = io.BytesIO()
    npy.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return head.getvalue()


def test_a_numpy_archive_that_claims_gigabytes_is_refused() -> None:
    with pytest.raises(CalibrationError, match="K1, D1, K2, D2, R and T are missing"):
        read_any([archive_of(head_of(1 << 40))])


@pytest.mark.parametrize(
    "head",
    [
        pytest.param(head_of(-1), id="negative size"),
        pytest.param(head_of(9).replace(b"(9,)", b"(3L,"), id="unfinished"),
        pytest.param(head_of(9).replace(b"'shape': (9,)", b"[]: 2        "), id="no key"),
        pytest.param(b"text", id="no array"),
    ],
)
def test_a_damaged_numpy_archive_is_refused(head: bytes) -> None:
    with pytest.raises(CalibrationError, match=r"^big\.npz: the archive is damaged"):
        read_any([archive_of(head)])


def test_a_numpy_archive_of_a_future_format_is_refused() -> None:
    content = bytearray(archive_of(head_of(9)).content)
    # The version needed to extract the member, in the central directory.
    content[content.rindex(b"PK\x01\x02") + 6] = 124
    with pytest.raises(CalibrationError):
        read_any([NamedFile("new.npz", bytes(content))])


@pytest.mark.parametrize("shared", [False, True])
def test_intrinsics_and_extrinsics_are_joined(shared: bool) -> None:
    whole = exported("opencv")[0].content.decode()
    head, rest = whole.split("R: !!opencv", 1)
    extrinsics = "%YAML:1.0\n---\nR: !!opencv" + rest + "Q: [1, 2]\n"
    # Keys in both files are fine as long as they agree.
    pair = texts(head, extrinsics + ("image_width: 640\n" if shared else ""))
    for files in (pair, pair[::-1]):
        understood = read_any(files)
        assert understood.format == "OpenCV FileStorage in two files"
        assert np.array_equal(understood.calibration.K1, RIG.K1)
        assert np.array_equal(understood.calibration.R, RIG.R)
    for name, files in (("R and T are", pair[:1]), ("K1, D1, K2 and D2 are", pair[1:])):
        with pytest.raises(CalibrationError, match=f"{name} missing; OpenCV's stereo_calib writes"):
            read_any(files)
    with pytest.raises(CalibrationError, match="image_width differs from image_width in file0"):
        read_any(texts(head, extrinsics + "image_width: 320\n"))


def test_other_spellings_of_opencv_keys_are_read() -> None:
    understood = read_any(texts(
        "Size: [640, 480]\nK_LEFT: [500,0,320,0,501,240,0,0,1]\nD_LEFT_FE: [.1,.2,.3,.4]\n"
        "K_RIGHT: [500,0,320,0,501,240,0,0,1]\nD_RIGHT_FE: [.1,.2,.3,.4]\n"
        "R: [0.01, 0.02, 0.03]\nT: [-120.0, 0, 0]\n"
    ), unit="mm")  # fmt: skip
    made = understood.calibration
    assert made.distortion_model == "equidistant"
    assert np.allclose(made.R, cv2.Rodrigues(np.array([0.01, 0.02, 0.03]))[0])
    assert "R has three numbers and is read as a rotation vector" in understood.notes
    assert "D_LEFT_FE and D_RIGHT_FE: fisheye lenses" in understood.notes


WHOLE = exported("opencv")[0].content.decode()


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        ((), "no calibration file was given"),
        (texts("a", "b", "c"), "3 files were given; a calibration is one file, or two"),
        (texts(WHOLE, ZED), "file0 is an OpenCV calibration, but file1 is a ZED calibration"),
        (texts(ZED, ZED), "a ZED calibration is a single file for both cameras, but 2 were given"),
        (texts("K: 1\nP: 2\n"), "not a known calibration format (its keys: K, P); supported are"),
        (texts(""), "the file is empty; it must be in a supported format: OpenCV (YAML, XML or"),
        (texts("just words"),
         "the file contains no keys with values; it must be in a supported format: OpenCV (YAML"),
        (texts("<a>words</a>"), "it must be in a supported format: OpenCV (YAML, XML or JSON; one"),
        ((NamedFile("d.mat", b"\x8b\xff\0"),),
         "d.mat is not a MATLAB file, and no other supported format: OpenCV (YAML, XML or JSON;"),
        ((NamedFile("d.bin", b"K1: \0"),), "d.bin is not a text file, and no other supported form"),
        (texts("camera_matrix: [1]\ndistortion_coefficients: [0]\n"),
         "this is the calibration of a single camera"),
        ((NamedFile("a.zip", b"PK\x03\x04abc"),), "a.zip: this is a ZIP archive; unpack it"),
        ((NamedFile("a", b"\xff\xfeK"),), "a is not a text file, and no other supported"),
        (texts("# Camera list\n#  CAMERA_ID, MODEL\n1 PINHOLE 640 480 500 500 320 240\n"),
         "file0: this is COLMAP's list of cameras, which lacks the extrinsics"),
        (texts("version https://git-lfs.github.com/spec/v1\noid sha256:0\n"), "run git lfs pull"),
        (texts("\n<!DOCTYPE html>\n<html>"), "this is a web page; download the file itself"),
        ((NamedFile("a", b"#" * 1_000_001),), "larger than the 1000000 bytes"),
        ((NamedFile("a.mat", b"MATLAB 5.0 MAT-file" + bytes(1_000_000)),), "larger than the 10"),
        (texts("K1: &a [1, 2]\nK2: *a\n"), "line 1 uses a YAML alias"),
        (texts(WHOLE.replace("[ -0.12, ", "[ 0.12, ")), "swap left and right"),
        (texts(WHOLE.replace("[ -0.12, ", "[ .inf, ")), "T must contain finite numbers only"),
        (texts(WHOLE.replace("[ -0.12, 0.001, 0.002 ]", "[0, 0, 0]")), "T must not be zero"),
        (texts(re.sub(r"(D1.*?)dt: d\n.*?]", r"\1data: [0.1]", WHOLE, count=1, flags=re.DOTALL)),
         "D1 must contain 1 x 4 numbers, but it holds 1"),
        (texts(WHOLE.replace("[ 500.0, 0.0, 320.0, 0.0, 501.0, 240.0, 0.0, 0.0, 1.0 ]",
                             "[ 500.0, 0, 0, 0, 501.0, 0, 320, 240, 1.0 ]")),
         "K1 must have the rows fx, 0, cx; 0, fy, cy; 0, 0, 1; it is transposed"),
        (texts(WHOLE + "distortion_model: ds\n"), "distortion_model must be radtan or equidistant"),
        (texts(WHOLE.replace("[ -0.1, 0.02, 0.0, 0.0 ]", "[0.1, 0, 0, 0, 0]")
               .replace("cols: 4", "cols: 5", 1) + "distortion_model: equidistant\n"),
         "D1 of an equidistant (fisheye) lens must contain 4 coefficients, not 5"),
    ],
)  # fmt: skip
def test_refuses(files: tuple[NamedFile, ...], expected: str) -> None:
    with pytest.raises(CalibrationError) as caught:
        read_any(files)
    message = str(caught.value)
    assert expected in message
    assert "\n" not in message
    assert len(message) < 500


def test_named_file_reads_a_file_from_disk(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(WHOLE)
    assert named_file(tmp_path / "c.yaml") == NamedFile("c.yaml", WHOLE.encode())
    with pytest.raises(CalibrationError, match="cannot be read: No such file"):
        named_file(tmp_path / "absent.yaml")


@pytest.mark.parametrize("number", [0, 1])
@given(
    format=st.sampled_from(sorted(FORMATS)),
    part=st.floats(0, 1),
    length=st.integers(0, 30),
    put=st.binary(max_size=12) | st.sampled_from([b"1e308", b"-1e200 ", b"0", b"nan", b"\n", b":"]),
)
@settings(max_examples=250)
def test_damaged_files_are_read_or_refused(
    number: int, format: str, part: float, length: int, put: bytes
) -> None:
    files = list(FORMATS[format])
    file = files[number % len(files)]
    at = int(part * len(file.content))
    damaged = file.content[:at] + put + file.content[at + length :]
    files[number % len(files)] = NamedFile(file.name, damaged)
    for size in (SIZES.get(format), None):
        with contextlib.suppress(CalibrationError):
            read_any(files, size=size)


@given(content=st.binary(max_size=120), second=st.none() | st.binary(max_size=40))
@settings(max_examples=250)
def test_arbitrary_bytes_are_refused(content: bytes, second: bytes | None) -> None:
    files = [NamedFile("a", content)] + ([] if second is None else [NamedFile("b", second)])
    with pytest.raises(CalibrationError):
        read_any(files)


@given(
    st.text("[]=;:_.-0123456789 \nPKSDRTcamLEFTRIGHT_CAM_HD STEREO", max_size=80).map(
        lambda text: text.encode()
    ),
    st.sampled_from([b"[LEFT_CAM_HD]\n", b"cam0=[", b"S_00: 1\n", b"P0: 1\n", b"cam0: {a: 1}\n",
                     b"T_BS: 1\n", b"camera_matrix: 1\nprojection_matrix: 2\n"]),
)  # fmt: skip
@settings(max_examples=200)
def test_content_that_only_resembles_a_format_is_refused(content: bytes, start: bytes) -> None:
    for files in ([start + content], [start + content, start]):
        with pytest.raises(CalibrationError):
            read_any([NamedFile(f"file{i}", each) for i, each in enumerate(files)], size=(640, 480))
