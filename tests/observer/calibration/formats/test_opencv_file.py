"""OpenCV calibration files: what is read, what is refused, and the wording of refusals."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.calibration.formats.opencv_file import (
    calibration_text,
    read_calibration,
    read_noted_calibration,
)
from observer.camera import StereoCalibration
from observer.errors import CalibrationError

KEYS = ("K1", "D1", "K2", "D2", "R", "T")


def example(**changes: object) -> StereoCalibration:
    values: dict[str, object] = {
        "width": 640,
        "height": 480,
        "K1": [[500.1, 0, 320.123456789012], [0, 501, 240.2], [0, 0, 1]],
        "D1": [0.1, -2.3e-7, 0, 1e-3, 1 / 3],
        "K2": [[499.9, 0, 318], [0, 500, 241], [0, 0, 1]],
        "D2": [-0.2, 0.1, 0, 0],
        "R": cv2.Rodrigues(np.array([0.01, 0.02, -0.03]))[0],
        "T": [-0.12, 1e-17, 0.002],
    }
    return StereoCalibration(**(values | changes))  # type: ignore[arg-type]


def assert_same(a: StereoCalibration, b: StereoCalibration) -> None:
    assert (a.width, a.height) == (b.width, b.height)
    for key in KEYS:
        assert np.array_equal(getattr(a, key), getattr(b, key)), key


def written_by_opencv(calibration: StereoCalibration, extension: str) -> str:
    storage = cv2.FileStorage(extension, cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("image_width", calibration.width)
    storage.write("image_height", calibration.height)
    storage.write("note", "made by: hand, 'quoted'")
    for key in KEYS:
        storage.write(key, getattr(calibration, key))
    return storage.releaseAndGetString()


def test_round_trip_keeps_every_digit() -> None:
    assert_same(read_calibration(calibration_text(example()), name="a.yaml"), example())


def test_round_trip_of_a_rectified_pair_stays_rectified() -> None:
    made = StereoCalibration.rectified(512, 256, 443.4, 443.4, 255.5, 127.5, 0.12)
    read = read_calibration(calibration_text(made), name="a.yaml")
    assert_same(read, made)
    assert read.is_rectified


@given(
    numbers=st.lists(st.floats(-5, 5, allow_subnormal=True), min_size=5, max_size=5),
    rotvec=st.lists(st.floats(-0.5, 0.5), min_size=3, max_size=3),
    baseline=st.floats(-1.9, -0.0011),
)
@settings(max_examples=40)
def test_round_trip_of_any_calibration(
    numbers: list[float], rotvec: list[float], baseline: float
) -> None:
    made = example(D1=numbers, R=cv2.Rodrigues(np.array(rotvec))[0], T=[baseline, 0, 0])
    assert_same(read_calibration(calibration_text(made), name="a.yaml"), made)


def test_opencv_reads_what_we_write() -> None:
    flags = cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY
    storage = cv2.FileStorage(calibration_text(example()), flags)
    assert storage.getNode("image_width").real() == 640
    for key in KEYS:
        value = storage.getNode(key).mat()
        assert np.array_equal(value.reshape(getattr(example(), key).shape), getattr(example(), key))


@pytest.mark.parametrize("extension", [".yml", ".xml", ".json"])
def test_reads_what_opencv_writes(extension: str) -> None:
    text = written_by_opencv(example(), extension)
    assert_same(read_calibration(text, name="a" + extension), example())


def test_reads_other_spellings_plain_lists_and_a_byte_order_mark() -> None:
    text = (
        "\ufeff%YAML:1.0\n---\nimageSize: [640, 480]\n"
        "cameraMatrix1: [[500, 0, 320], [0, 500, 240], [0, 0, 1]]\ndistCoeffs1: [0, 0, 0, 0]\n"
        "M2: [500, 0, 320, 0, 500, 240, 0, 0, 1]\nD2: [0., 1e-3, .5, -1.]\n"
        "R: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nT: [-0.1, 0, 0]   # metres\n"
    )
    read = read_calibration(text, name="a.yaml")
    assert (read.width, read.height, read.baseline) == (640, 480, 0.1)
    assert read.D2.tolist() == [0, 0.001, 0.5, -1]


def test_reads_opencv_sample_pair_merged_into_one_file(shared_data: Path) -> None:
    intrinsics = (shared_data / "chessboards" / "intrinsics.yml").read_text()
    with pytest.raises(CalibrationError, match=r"R and T are missing; .*extrinsics\.yml"):
        read_calibration(intrinsics, name="intrinsics.yml")
    rest = "R: [1,0,0,0,1,0,0,0,1]\nT: [-0.0836, 0, 0]\nimage_width: 640\nimage_height: 480\n"
    read = read_calibration(intrinsics + rest, name="both.yml")
    assert read.K1[0, 0] == 534.80326845051309
    assert read.D2[0] == -0.16916358306948096


GOOD = calibration_text(example())


def replaced(pattern: str, by: str) -> str:
    text, count = re.subn(pattern, by, GOOD, count=1, flags=re.DOTALL)
    assert count == 1
    return text


ONE = r"K1: !!opencv-matrix\s+rows: 3\s+cols: 3\s+dt: d\s+data: \[[^\]]*\]"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (replaced(ONE + "\n", ""), "K1 is missing"),
        (replaced("image_width: 640\n", ""), "image_width is missing"),
        (replaced("image_width: 640", "image_width: 640.5"), "image_width must be a whole number"),
        (replaced("image_width: 640", "image_width: -640"), "image_width must be a whole number"),
        (replaced("image_width: 640", "image_width: 3"), "between 8 and 16384"),
        (replaced(ONE, "K1: hello"), "K1 must contain numbers only, not 'hello'"),
        (replaced(ONE, "K1: [1, 2, 3]"), "K1 must have shape 3 x 3"),
        (replaced(ONE, "K1: {rows: 3, cols: 3}"), "K1 must be a matrix, but it has no data"),
        (replaced("rows: 3", "rows: 1"), "K1 must have shape 3 x 3, not 1 x 9"),
        (replaced("rows: 3", "rows: 4"), "K1 must contain 4 x 3 numbers, but it holds 9"),
        (replaced("rows: 3", "rows: 999999999999"), "K1.rows must be a whole number"),
        (replaced("500.1,", ".Nan,"), "K1 must contain finite numbers only"),
        (replaced("500.1,", "-.Inf,"), "K1 must contain finite numbers only"),
        (replaced("500.1,", "1e999,"), "K1 must contain finite numbers only"),
        (replaced("500.1,", "-500.1,"), "K1 must be a camera matrix with positive focal"),
        (replaced("500.1,", "5_0,"), "K1 must contain numbers only, not '5_0'"),
        (replaced(r"\nR: .*?\]", "\nR: [2, 0, 0, 0, 1, 0, 0, 0, 1]"), "R must be a rotation"),
        (replaced(r"\nR: .*?\]", "\nR: [1, 0, 0, 0, 1, 0, 0, 0, -1]"), "R must be a rotation"),
        (replaced(r"data: \[ -0.12, 1e-17, 0.002 \]", "data: [0, 0, 0]"), "T must not be zero"),
        (replaced(r"-0.12, 1e-17, 0.002", "-120, 0, 0"), "in millimetres (120 mm), set unit='mm'"),
        (replaced(r"-0.12, 1e-17, 0.002", "-12000, 0, 0"), "outside 0.001 to 2 m"),
        (replaced(r"rows: 3\s+cols: 1\s+dt: d\s+data: \[ -0.12, 1e-17, 0.002 \]",
                  "rows: 2\n   cols: 1\n   data: [-0.1, 0]"), "T must contain 3 numbers, not 2"),
        (replaced(r"rows: 1\s+cols: 5.*?\]", "rows: 1\n   cols: 3\n   data: [0, 0, 0]"),
         "D1 must contain 4, 5, 8, 12 or 14"),
        (GOOD + "K1: [1]\n", "K1 appears twice"),
        (GOOD + "---\nK1: 1\n", "more than one YAML document"),
        ("%YAML:1.0\n---\nK1: &a [1, 2]\nK2: *a\n", "line 3 uses a YAML alias"),
        ("%YAML:1.0\n---\nK1: [1, 2]\nK2: *a\n", "line 4 uses a YAML alias"),
        (GOOD[: GOOD.index("K2") + 90], "truncated or not valid YAML"),
        (GOOD[: GOOD.index("K2")], "K2, D2, R and T are missing"),
        ("", "the file is empty"),
        (" \n", "the file is empty"),
        ("just words", "the file contains no keys"),
        ("[1, 2]", "the file contains no keys"),
        ("{" + '"K1": ' + "[" * 100_000, "nested too deeply"),
        ("K1: " + "[" * 900, "nested too deeply"),
        ('{"K1": [1, 2', "not valid JSON in line 1"),
        ("<opencv_storage><K1>", "not valid XML"),
        ("<a>" * 90_000 + "</a>" * 90_000, "nested too deeply"),
        ('<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "declares a document"),
        ("K1: \x00\x01", "control characters"),
        ("K1: \ud800", "must be UTF-8"),
        ("# " + "x" * 1_000_000, "may have at most 1000000"),
        ("? [a, b]\n: 1\n", "is not a plain word"),
    ],
)  # fmt: skip
def test_refuses(text: str, expected: str) -> None:
    with pytest.raises(CalibrationError) as caught:
        read_calibration(text, name="mine.yaml")
    message = str(caught.value)
    assert message.startswith("mine.yaml: ")
    assert expected in message
    assert "\n" not in message
    assert len(message) < 400


@given(
    position=st.integers(0, len(GOOD)),
    length=st.integers(0, 40),
    inserted=st.text(max_size=20),
    extension=st.sampled_from([".yml", ".xml", ".json"]),
)
@settings(max_examples=300)
def test_damaged_file_is_read_or_refused_with_a_one_line_reason(
    position: int, length: int, inserted: str, extension: str
) -> None:
    whole = written_by_opencv(example(), extension)
    damaged = whole[:position] + inserted + whole[position + length :]
    refusal = ""
    try:
        read_calibration(damaged, name="damaged")
    except CalibrationError as error:
        refusal = str(error)
    assert not refusal or refusal.startswith("damaged: ")
    assert "\n" not in refusal


@given(st.text() | st.text("{}[]<>:&*!-,? \n\"'K1", max_size=60))
@settings(max_examples=300)
def test_any_text_is_refused(text: str) -> None:
    with pytest.raises(CalibrationError):
        read_calibration(text, name="any")


def test_file_refusals_name_the_file(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="cannot be read: No such file"):
        read_noted_calibration(tmp_path / "absent.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"\xfe\x00K")
    with pytest.raises(CalibrationError, match=r"binary\.yaml: the file must be UTF-8"):
        read_noted_calibration(tmp_path / "binary.yaml")
    (tmp_path / "large.yaml").write_bytes(b"#" * 1_000_001)
    with pytest.raises(CalibrationError, match=r"large\.yaml: the file is larger than"):
        read_noted_calibration(tmp_path / "large.yaml")
    with pytest.raises(CalibrationError, match="cannot be read"):
        read_noted_calibration(tmp_path)


def test_reads_a_file(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(GOOD)
    assert_same(read_noted_calibration(tmp_path / "c.yaml")[0], example())
