"""Sequences in the layouts of KITTI: odometry, and raw as extracted and as rectified."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from observer.errors import CalibrationError, SourceError
from observer.sources.folders import open_folder
from observer.types import StereoFrame

from .playing import frames, number_of, reasons


def test_kitti_oncoming_plays_in_colour(shared_data: Path) -> None:
    source = open_folder(shared_data / "kitti_oncoming")
    assert source.info.kind == "KITTI odometry"
    assert (source.info.width, source.info.height, source.info.frame_count) == (1241, 376, 20)
    assert source.info.frame_rate == pytest.approx(9.64, abs=0.01)
    calibration = source.calibration
    assert calibration is not None
    assert calibration.is_rectified
    # Cameras 2 and 3: (45.38225 + 337.2877) / 718.856.
    assert calibration.baseline == pytest.approx(0.5323318)
    seen = frames(source)
    assert len(seen) == 20
    assert all(frame.left.shape == frame.right.shape == (376, 1241, 3) for frame in seen)
    assert seen[1].time == 0.1036117


def test_kitti_static_plays_in_grey(shared_data: Path) -> None:
    source = open_folder(shared_data / "kitti_static")
    assert source.info.frame_count == 30
    assert source.calibration is not None
    assert source.calibration.baseline == pytest.approx(379.8145 / 707.0912)
    assert source.calibration.K1[0, 2] == 601.8873
    frame = source.read()
    assert isinstance(frame, StereoFrame)
    assert frame.left.shape == (370, 1226)


def test_kitti_odometry_without_calibration_still_plays(shared_data: Path, tmp_path: Path) -> None:
    folder = tmp_path / "part"
    for camera in ("image_0", "image_1"):
        (folder / camera).mkdir(parents=True)
        for number in (7, 8, 10):  # a part of a sequence beside the whole times.txt
            name = f"{number:06d}.png"
            shutil.copy(shared_data / "kitti_static" / camera / name, folder / camera)
    shutil.copy(shared_data / "kitti_static" / "times.txt", folder)
    source = open_folder(folder)
    assert source.calibration is None
    assert reasons(source) == {
        2: "frame 9 is missing in image_0 and image_1",
        4: "times.txt has 19 more lines after the last image",
    }
    source.rewind()
    times = [float(line) for line in (folder / "times.txt").read_text().split()]
    assert [frame.time for frame in frames(source)] == [times[7], times[8], times[10]]
    shutil.rmtree(folder / "image_1")
    with pytest.raises(SourceError, match="images of only one camera; KITTI odometry needs"):
        open_folder(folder)


def test_kitti_raw_keeps_each_images_own_time(shared_data: Path) -> None:
    source = open_folder(shared_data / "kitti_raw_unrectified")
    assert source.info.kind == "KITTI raw"
    assert (source.info.width, source.info.height, source.info.frame_count) == (1392, 512, 16)
    seen = frames(source)
    assert len(seen) == 16
    assert seen[0].time == 0
    # From ...06.052646144 to ...06.155802368 on the left; 06.052570112 on the right.
    assert seen[1].time == pytest.approx(0.103156224, abs=1e-12)
    assert seen[0].right_time == pytest.approx(-0.000076032, abs=1e-12)


@pytest.fixture
def raw_drive(shared_data: Path, tmp_path: Path) -> Path:
    """Four pairs of the raw drive, its calibration one folder up as KITTI ships it."""
    drive = tmp_path / "2011_09_26" / "drive_0001_extract"
    original = shared_data / "kitti_raw_unrectified"
    for camera in ("image_00", "image_01"):
        (drive / camera / "data").mkdir(parents=True)
        for number in range(4):
            shutil.copy(original / camera / "data" / f"{number:010d}.png", drive / camera / "data")
        stamps = (original / camera / "timestamps.txt").read_text().splitlines()[:4]
        (drive / camera / "timestamps.txt").write_text("\n".join(stamps))
    shutil.copy(original / "calib_cam_to_cam.txt", drive.parent)
    return drive


def test_kitti_raw_finds_the_calibration_of_its_date(raw_drive: Path) -> None:
    calibration = open_folder(raw_drive).calibration
    assert calibration is not None
    assert calibration.baseline == pytest.approx(0.53717, abs=1e-4)
    assert calibration.K2[0, 0] == 989.5267
    (raw_drive.parent / "calib_cam_to_cam.txt").unlink()
    assert open_folder(raw_drive).calibration is None


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("K_01: ", "K_01: 1 ", "K_01 must contain 9 numbers, not 10"),
        ("K_01: ", "X_01: ", "K_01 is missing"),
        ("D_00: -3.728755e-01", "D_00: nan", "D_00 must contain finite numbers only"),
        ("D_00: -3.728755e-01", "D_00: left", "D_00 must contain numbers only"),
        (
            "S_00: 1.392000e+03",
            "S_00: 640",
            "the images are 1392x512 pixels, which matches neither",
        ),
        ("R_01: 9.993513e-01", "R_01: 0.5", "R must be a rotation matrix"),
    ],
)
def test_kitti_raw_refuses_a_damaged_calibration(
    old: str, new: str, expected: str, raw_drive: Path
) -> None:
    file = raw_drive.parent / "calib_cam_to_cam.txt"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(CalibrationError, match=f"^calib_cam_to_cam.txt: {expected}"):
        open_folder(raw_drive)


def test_kitti_raw_refuses_a_malformed_stamp(raw_drive: Path) -> None:
    (raw_drive / "image_00" / "timestamps.txt").write_text("2011-09-26 14:06:06.05\nyesterday\n")
    with pytest.raises(SourceError, match=r"image_00/timestamps\.txt line 2 must be a time such"):
        open_folder(raw_drive)


def test_images_that_were_not_taken_together_are_no_pair(raw_drive: Path) -> None:
    file = raw_drive / "image_01" / "timestamps.txt"
    stamps = file.read_text().splitlines()
    # The second right image is that of the next frame.
    file.write_text("\n".join([stamps[0], stamps[2], *stamps[2:]]))
    source = open_folder(raw_drive)
    assert [frame.index for frame in frames(source)] == [0, 2, 3]
    source.rewind()
    assert reasons(source) == {1: "the two images named 0000000001.png were taken 0.103 s apart"}
    file.write_text("\n".join(each.replace("2011-09-26", "2011-09-27") for each in stamps))
    with pytest.raises(
        SourceError, match=r"no stereo pair \(the two images named 0000000000\.png were taken"
    ):
        open_folder(raw_drive)


def test_kitti_raw_sync_is_already_rectified(
    tmp_path: Path, make_image: Callable[..., np.ndarray]
) -> None:
    for camera, side in (("image_02", "left"), ("image_03", "right")):
        (tmp_path / camera / "data").mkdir(parents=True)
        stamps = [f"2011-09-26 13:02:2{k}.{k}00000000\n" for k in range(3)]
        (tmp_path / camera / "timestamps.txt").write_text("".join(stamps))
        for number in range(3):
            image = make_image(number, side, (128, 40))
            cv2.imwrite(str(tmp_path / camera / "data" / f"{number:010d}.png"), image)
    (tmp_path / "calib_cam_to_cam.txt").write_text(
        "S_02: 140 60\nS_03: 140 60\nS_rect_02: 128 40\nS_rect_03: 128 40\n"
        "P_rect_02: 100 0 64 4 0 100 20 0 0 0 1 0\nP_rect_03: 100 0 64 -46 0 100 20 0 0 0 1 0\n"
    )
    source = open_folder(tmp_path)
    assert source.calibration is not None
    assert source.calibration.is_rectified
    assert source.calibration.baseline == pytest.approx(0.5)
    assert [number_of(frame) for frame in frames(source)] == [0, 1, 2]
    source.rewind()
    assert [frame.time for frame in frames(source)] == pytest.approx([0, 1.1, 2.2])
