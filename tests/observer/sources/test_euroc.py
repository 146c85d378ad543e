"""Sequences in the layout of EuRoC."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from observer.errors import CalibrationError, SourceError
from observer.sources.folders import open_folder

from .playing import frames, number_of, reasons

STAMPS = [1403636579763555584 + 50_000_000 * k for k in range(4)]
SENSOR = """#Default
sensor_type: camera
comment: VI-Sensor cam (MT9M034)
T_BS:
  cols: 4
  rows: 4
  data: [{T_BS}]
rate_hz: 20
resolution: [64, 48]
camera_model: pinhole
intrinsics: [60.5, 61.0, 31.0, 24.0] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
"""
# The left camera is turned by 90 degrees in the body, the right one is 0.11 m to its right.
LEFT_T_BS = "0, -1, 0, -0.02, 1, 0, 0, -0.06, 0, 0, 1, 0.01, 0, 0, 0, 1"
RIGHT_T_BS = "0, -1, 0, -0.02, 1, 0, 0, 0.05, 0, 0, 1, 0.01, 0, 0, 0, 1"


@pytest.fixture
def euroc(tmp_path: Path, make_image: Callable[..., np.ndarray]) -> Path:
    for camera, side, T_BS in (("cam0", "left", LEFT_T_BS), ("cam1", "right", RIGHT_T_BS)):
        folder = tmp_path / "mav0" / camera
        (folder / "data").mkdir(parents=True)
        lines = [f"{stamp},{stamp}.png" for stamp in STAMPS]
        (folder / "data.csv").write_text("#timestamp [ns],filename\r\n" + "\r\n".join(lines))
        (folder / "sensor.yaml").write_text(SENSOR.format(T_BS=T_BS))
        for number, stamp in enumerate(STAMPS):
            cv2.imwrite(str(folder / "data" / f"{stamp}.png"), make_image(number, side))
    return tmp_path


@pytest.mark.parametrize("inside", ["", "mav0"])
def test_euroc_plays_with_its_composed_calibration(inside: str, euroc: Path) -> None:
    source = open_folder(euroc / inside)
    assert source.info.kind == "EuRoC"
    assert source.info.frame_rate == pytest.approx(20)
    seen = frames(source)
    assert [number_of(frame) for frame in seen] == [0, 1, 2, 3]
    assert [frame.time for frame in seen] == pytest.approx([0, 0.05, 0.1, 0.15], abs=1e-12)
    calibration = source.calibration
    assert calibration is not None
    assert np.allclose(calibration.R, np.eye(3))
    assert pytest.approx([-0.11, 0, 0]) == calibration.T
    assert calibration.K1[0].tolist() == [60.5, 0, 31]
    assert calibration.D2[3] == 1.76187114e-05


def test_euroc_pairs_by_stamp(euroc: Path) -> None:
    right = euroc / "mav0" / "cam1" / "data.csv"
    right.write_text("\n".join(f"{stamp},{stamp}.png" for stamp in STAMPS if stamp != STAMPS[1]))
    (euroc / "mav0" / "cam0" / "data" / f"{STAMPS[2]}.png").unlink()
    source = open_folder(euroc)
    assert reasons(source) == {
        1: f"the image with timestamp {STAMPS[1]} is missing in cam1",
        2: f"data/{STAMPS[2]}.png is missing",
    }
    source.rewind()
    assert [number_of(frame) for frame in frames(source)] == [0, 3]


def test_euroc_without_calibration_still_plays(euroc: Path) -> None:
    (euroc / "mav0" / "cam1" / "sensor.yaml").unlink()
    source = open_folder(euroc)
    assert source.calibration is None
    assert len(frames(source)) == 4


@pytest.mark.parametrize(
    ("file", "old", "new", "error", "expected"),
    [
        (
            "data.csv",
            f"{STAMPS[2]},",
            "soon,",
            SourceError,
            r"cam1/data\.csv line 4 must be a timest",
        ),
        ("data.csv", f",{STAMPS[2]}", ",../../x", SourceError, "must name a file in data"),
        ("data.csv", f"{STAMPS[2]},", f"{STAMPS[1]},", SourceError, "repeats the timestamp"),
        ("data.csv", "14036", "24036", SourceError, "no timestamp occurs in both"),
        ("sensor.yaml", "radial-tangential", "equidistant", CalibrationError, "_model is equi"),
        ("sensor.yaml", "intrinsics", "x", CalibrationError, r"cam1/sensor\.yaml: intrinsics is m"),
        ("sensor.yaml", "[64, 48]", "[32, 48]", CalibrationError, "resolution is 32x48, but the"),
        ("sensor.yaml", "[64, 48]", "[64]", CalibrationError, "resolution must contain 2 numbers"),
        (
            "sensor.yaml",
            "0, -1, 0, -0.02",
            "0, -3, 0, -0.02",
            CalibrationError,
            "T_BS must contain a",
        ),
        ("sensor.yaml", RIGHT_T_BS, LEFT_T_BS, CalibrationError, "T must not be zero"),
    ],
)
def test_euroc_refuses_damaged_files(
    file: str, old: str, new: str, error: type[Exception], expected: str, euroc: Path
) -> None:
    path = euroc / "mav0" / "cam1" / file
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(error, match=expected):
        open_folder(euroc)


def test_euroc_needs_both_cameras(euroc: Path) -> None:
    shutil.rmtree(euroc / "mav0" / "cam1")
    with pytest.raises(SourceError, match="has no cam1; EuRoC's layout needs cam0"):
        open_folder(euroc)


def test_stamps_that_are_not_in_nanoseconds_are_refused(euroc: Path) -> None:
    for camera in ("cam0", "cam1"):
        file = euroc / "mav0" / camera / "data.csv"
        file.write_text("".join(f"{stamp // 1000},{stamp}.png\n" for stamp in STAMPS))
    with pytest.raises(SourceError, match="are 5e-05 s apart, which no camera achieves; check the"):
        open_folder(euroc)
