"""KITTI's calibration files, checked against the meaning of their numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from observer.calibration.formats.kitti_file import read_kitti_odometry, read_kitti_raw
from observer.calibration.formats.recognition import read_any
from observer.calibration.formats.understanding import NamedFile
from observer.errors import CalibrationError

SIZE = (1392, 512)


def line(key: str, values: npt.ArrayLike) -> str:
    return f"{key}: {' '.join(repr(float(v)) for v in np.ravel(values))}\n"


@pytest.fixture
def cameras(tmp_path: Path) -> tuple[Path, dict[str, np.ndarray]]:
    """A raw file whose four cameras are all rotated and offset from camera 0's frame."""
    rng = np.random.default_rng(5)
    values: dict[str, np.ndarray] = {}
    for k in range(4):
        values[f"S_{k:02d}"] = np.array(SIZE)
        values[f"K_{k:02d}"] = np.array([980 + k, 0, 690 + k, 0, 981 + k, 240 + k, 0, 0, 1])
        values[f"D_{k:02d}"] = rng.normal(0, 0.1, 5)
        values[f"R_{k:02d}"] = Rotation.from_rotvec(rng.normal(0, 0.03, 3)).as_matrix()
        values[f"T_{k:02d}"] = np.array([-0.25 * k, *rng.normal(0, 0.01, 2)])
    path = tmp_path / "calib_cam_to_cam.txt"
    text = "calib_time: 09-Jan-2012 13:57:47\n" + "".join(line(*item) for item in values.items())
    path.write_text(text)
    return path, values


@pytest.mark.parametrize("left", [0, 2])
def test_point_is_transformed_consistently_between_cameras(
    left: int, cameras: tuple[Path, dict[str, np.ndarray]]
) -> None:
    path, values = cameras
    calibration = read_kitti_raw(path, left, *SIZE)
    a, b = f"{left:02d}", f"{left + 1:02d}"
    points = np.random.default_rng(0).uniform(-5, 5, (20, 3))  # in camera 0's frame
    in_left = points @ values[f"R_{a}"].T + values[f"T_{a}"]
    in_right = points @ values[f"R_{b}"].T + values[f"T_{b}"]
    assert in_left @ calibration.R.T + calibration.T == pytest.approx(in_right, abs=1e-12)
    assert np.array_equal(calibration.K1.ravel(), values[f"K_{a}"])
    assert np.array_equal(calibration.K2.ravel(), values[f"K_{b}"])
    assert np.array_equal(calibration.D2, values[f"D_{b}"])


def test_rectified_cameras_2_and_3_subtract_both_offsets(tmp_path: Path) -> None:
    path = tmp_path / "calib.txt"
    P = {k: [700, 0, 600, x, 0, 700, 180, 0, 0, 0, 1, 0] for k, x in enumerate((0, -350, 42, -329))}
    path.write_text("".join(line(f"P{k}", row) for k, row in P.items()))
    grey, colour = (read_kitti_odometry(path, left, 1241, 376) for left in (0, 2))
    assert grey.is_rectified
    assert colour.is_rectified
    assert (grey.baseline, colour.baseline) == pytest.approx((0.5, 0.53))


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("P1", "P9", "P1 is missing"),
        ("-350.0", "0.0", "T must not be zero"),
        ("-350.0", "-350000.0", r"in millimetres \(500 mm\), set unit=.mm."),
        ("P1: 700.0", "P1: 701.0", "P0 and P1 must share one camera matrix"),
        ("P1: 700.0", "P1: inf", "P1 must contain finite numbers"),
        ("P1: 700.0", "P1:", "P1 must contain 12 numbers, not 11"),
    ],
)
def test_refuses(old: str, new: str, expected: str, tmp_path: Path) -> None:
    rows = ([700, 0, 600, x, 0, 700, 180, 0, 0, 0, 1, 0] for x in (0, -350))
    text = "".join(line(f"P{k}", row) for k, row in enumerate(rows))
    assert old in text
    path = tmp_path / "calib.txt"
    path.write_text(text.replace(old, new))
    with pytest.raises(CalibrationError, match=rf"^calib\.txt: .*{expected}"):
        read_kitti_odometry(path, 0, 1241, 376)


def test_refuses_an_unreadable_file(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="cannot be read"):
        read_kitti_odometry(tmp_path / "absent.txt", 0, 1241, 376)


def test_a_raw_file_without_sizes_is_refused(cameras: tuple[Path, dict[str, np.ndarray]]) -> None:
    path, _ = cameras
    lines = path.read_text().splitlines(keepends=True)
    colour = "".join(each for each in lines if "_00" not in each and "_01" not in each)
    with pytest.raises(CalibrationError, match=r"^colour\.txt: S_00 is missing$"):
        read_any([NamedFile("colour.txt", colour.encode())], cameras="grey")
    with pytest.raises(CalibrationError, match=r"^K\.txt: S_00 is missing$"):
        read_any([NamedFile("K.txt", b"K_00: 1.0 2\n")])
