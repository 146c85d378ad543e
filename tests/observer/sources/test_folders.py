"""Stereo folders, KITTI and EuRoC: found by content, read in order, damage reported."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from observer.calibration.formats.opencv_file import calibration_text
from observer.camera import StereoCalibration
from observer.errors import CalibrationError, SourceError
from observer.sources.contract import NoFrame, SkippedFrame, Source
from observer.sources.folders import open_folder
from observer.types import StereoFrame

CALIBRATION = StereoCalibration.rectified(64, 48, 60.0, 60.0, 31.5, 23.5, 0.12)


def played(source: Source) -> list[StereoFrame | SkippedFrame]:
    result: list[StereoFrame | SkippedFrame] = []
    while (item := source.read()) is not None:
        assert not isinstance(item, NoFrame)
        result.append(item)
        assert len(result) < 1000
    return result


def frames(source: Source) -> list[StereoFrame]:
    return [item for item in played(source) if isinstance(item, StereoFrame)]


def reasons(source: Source) -> dict[int, str]:
    return {item.index: item.reason for item in played(source) if isinstance(item, SkippedFrame)}


def number_of(frame: StereoFrame) -> int:
    """Return the number that ``marked_image`` encoded; fail if left and right are swapped."""
    left, right = frame.left.mean(), frame.right.mean()
    assert right - left == pytest.approx(20, abs=1)
    return round((left - 40) / 4)


# --- stereo folder -----------------------------------------------------------------------------


def test_a_stereo_folder_plays_in_order(stereo_folder: Path) -> None:
    source = open_folder(stereo_folder)
    assert source.info.kind == "stereo folder"
    assert (source.info.width, source.info.height, source.info.frame_count) == (64, 48, 5)
    assert source.info.frame_rate == pytest.approx(10)
    assert not source.info.live
    assert source.calibration is None
    seen = frames(source)
    assert [frame.index for frame in seen] == [0, 1, 2, 3, 4]
    assert [number_of(frame) for frame in seen] == [0, 1, 2, 3, 4]
    assert [frame.time for frame in seen] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])
    assert sorted(frame.received for frame in seen) == [frame.received for frame in seen]
    assert source.read() is None


def test_rewind_restarts_and_close_may_be_called_twice(stereo_folder: Path) -> None:
    source = open_folder(stereo_folder)
    frames(source)
    source.rewind()
    assert [number_of(frame) for frame in frames(source)] == [0, 1, 2, 3, 4]
    source.close()
    source.close()


def test_a_folder_provides_its_calibration(stereo_folder: Path) -> None:
    (stereo_folder / "calibration.yaml").write_text(calibration_text(CALIBRATION))
    calibration = open_folder(stereo_folder).calibration
    assert calibration is not None
    assert np.array_equal(calibration.K1, CALIBRATION.K1)


def test_numeric_names_play_in_numeric_order(
    tmp_path: Path, make_image: Callable[..., np.ndarray]
) -> None:
    for number in range(12):
        for side in ("left", "right"):
            (tmp_path / side).mkdir(exist_ok=True)
            cv2.imwrite(str(tmp_path / side / f"{number}.png"), make_image(number, side))
    (tmp_path / "times.txt").write_text("# seconds\n" + "\n".join(f"{k}.5" for k in range(12)))
    seen = frames(open_folder(tmp_path))
    assert [number_of(frame) for frame in seen] == list(range(12))


def test_missing_truncated_and_resized_images_are_skipped_with_the_reason(
    stereo_folder: Path, make_image: Callable[..., np.ndarray]
) -> None:
    (stereo_folder / "right" / "000001.png").unlink()
    cut = stereo_folder / "left" / "000002.png"
    cut.write_bytes(cut.read_bytes()[:-200])
    cv2.imwrite(str(stereo_folder / "left" / "000003.png"), make_image(3, "left", (32, 48)))
    source = open_folder(stereo_folder)
    assert source.info.frame_count == 5
    assert reasons(source) == {
        1: "000001.png is missing in right",
        2: "left/000002.png is truncated: the PNG has no end marker",
        3: "left/000003.png is 32x48 pixels where the sequence has 64x48",
    }
    source.rewind()
    seen = frames(source)
    assert [number_of(frame) for frame in seen] == [0, 4]
    assert [frame.time for frame in seen] == pytest.approx([0, 0.4])


def test_an_image_missing_on_both_sides_shifts_no_times(stereo_folder: Path) -> None:
    for side in ("left", "right"):
        (stereo_folder / side / "000002.png").unlink()
    source = open_folder(stereo_folder)
    assert reasons(source) == {2: "frame 2 is missing in left and right"}
    source.rewind()
    assert [(number_of(f), round(f.time, 6)) for f in frames(source)] == [
        (0, 0.0), (1, 0.1), (3, 0.3), (4, 0.4),
    ]  # fmt: skip


def test_unequal_counts_of_times_are_reported(stereo_folder: Path) -> None:
    times = stereo_folder / "times.txt"
    times.write_text("0\n0.1\n0.2\n")
    assert reasons(open_folder(stereo_folder)) == {
        3: "000003.png has no time: times.txt ends before it",
        4: "000004.png has no time: times.txt ends before it",
    }
    times.write_text("".join(f"{k / 10}\n" for k in range(8)))
    source = open_folder(stereo_folder)
    assert reasons(source) == {5: "times.txt has 3 more lines after the last image"}
    source.rewind()
    assert len(frames(source)) == 5


def test_unequal_counts_with_names_that_are_not_numbers_are_refused(stereo_folder: Path) -> None:
    for side in ("left", "right"):
        for file in sorted((stereo_folder / side).iterdir()):
            file.rename(file.with_name(f"img-{file.name}"))
    assert len(frames(open_folder(stereo_folder))) == 5
    (stereo_folder / "times.txt").write_text("0\n0.1\n")
    with pytest.raises(SourceError, match=r"times\.txt contains 2 times for 5 image pairs"):
        open_folder(stereo_folder)


@pytest.mark.parametrize(
    ("times", "skipped", "kept"),
    [
        ([0, 0.1, 0.1, 0.3, 0.4], {2}, 4),
        ([0, 0.1, 99, 0.3, 0.4], {2}, 4),  # one spike costs one frame, not all behind it
        ([0, 0.1, 0.2, 0.05, 0.4], {3}, 4),
        ([50, 0.1, 0.2, 0.3, 0.4], {0}, 4),
    ],
)
def test_only_frames_whose_times_do_not_increase_are_skipped(
    times: list[float], skipped: set[int], kept: int, stereo_folder: Path
) -> None:
    (stereo_folder / "times.txt").write_text("\n".join(map(str, times)))
    source = open_folder(stereo_folder)
    found = reasons(source)
    assert len(found) == 5 - kept
    # Either of two equal times may be skipped.
    assert set(found) <= skipped | {k - 1 for k in skipped if times[k] == times[k - 1]}
    assert all("is not between those of the neighbouring frames" in r for r in found.values())
    source.rewind()
    rising = [frame.time for frame in frames(source)]
    assert rising == sorted(set(rising))


def remove(*paths: Path) -> None:
    for path in paths:
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()


@pytest.mark.parametrize(
    ("spoil", "expected"),
    [
        (lambda p: remove(p / "times.txt"), r"times\.txt is missing; speeds cannot be measured"),
        (lambda p: remove(p / "right"), r"the folder .*right is missing"),
        (lambda p: remove(*(p / "left").iterdir()), r"left contains no images"),
        (lambda p: (p / "times.txt").write_text("0\n0.1\nsoon\n"), r"times\.txt line 3 must be"),
        (lambda p: (p / "times.txt").write_text("0\nnan\n"), r"times\.txt line 2 must be a time"),
        (lambda p: (p / "times.txt").write_bytes(b"\xff\xfe0\n"), r"times\.txt must be a text"),
        (lambda p: (p / "times.txt").write_text("4\n3\n2\n1\n0\n"), "do not increase from frame"),
        (lambda p: (p / "times.txt").write_text("1\n1\n1\n1\n1\n"), "do not increase from frame"),
        (lambda p: [f.rename(f.with_name("x" + f.name)) for f in list((p / "left").iterdir())],
         "no file name occurs in both left and right"),
        (lambda p: [f.write_text("x") for f in (p / "left").iterdir()],
         r"no usable image pair: left/000000\.png is damaged or not an image"),
        (lambda p: remove(*(f for f in (p / "left").iterdir() if f.stem != "000001")),
         r"only one stereo pair .*at least two are needed"),
    ],
)  # fmt: skip
def test_an_unusable_stereo_folder_is_refused_in_one_sentence(
    spoil: Callable[[Path], object], expected: str, stereo_folder: Path
) -> None:
    spoil(stereo_folder)
    with pytest.raises(SourceError, match=expected) as caught:
        open_folder(stereo_folder)
    assert "\n" not in str(caught.value)


def test_an_unusable_calibration_is_refused(stereo_folder: Path) -> None:
    file = stereo_folder / "calibration.yaml"
    file.write_text("K1: [1, 2]")
    with pytest.raises(CalibrationError, match=r"calibration\.yaml: D1, K2, D2, R and T are"):
        open_folder(stereo_folder)
    other = StereoCalibration.rectified(640, 480, 600.0, 600.0, 320, 240, 0.12)
    file.write_text(calibration_text(other))
    with pytest.raises(CalibrationError, match=r"for images of 640x480 pixels, but these are 64x4"):
        open_folder(stereo_folder)


def test_a_path_that_is_not_a_stereo_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="there is no folder"):
        open_folder(tmp_path / "absent")
    with pytest.raises(
        SourceError, match="“hello world” is neither a known source nor an existing"
    ):
        open_folder(Path("hello world"))
    (tmp_path / "a.mp4").write_bytes(b"")
    with pytest.raises(SourceError, match=r"is a file; .*video:"):
        open_folder(tmp_path / "a.mp4")
    with pytest.raises(SourceError, match="no stereo images in a known layout"):
        open_folder(tmp_path)


# --- KITTI --------------------------------------------------------------------------------------


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


# --- EuRoC --------------------------------------------------------------------------------------

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
