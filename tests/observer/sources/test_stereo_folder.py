"""Stereo folders: found by content, read in order, damage reported."""

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
from observer.sources.folders import open_folder

from .playing import frames, number_of, reasons

CALIBRATION = StereoCalibration.rectified(64, 48, 60.0, 60.0, 31.5, 23.5, 0.12)


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


@pytest.mark.parametrize(
    ("unit", "per_second"), [("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9)]
)
def test_times_in_another_unit_are_refused(
    stereo_folder: Path, unit: str, per_second: float
) -> None:
    """Read as seconds, they would make every speed that many times too low."""
    times = [str(round((1.4e9 + 0.1 * k) * per_second)) for k in range(5)]
    (stereo_folder / "times.txt").write_text("\n".join(times))
    with pytest.raises(SourceError, match=f"so they seem to be in {unit}; they must be the expo"):
        open_folder(stereo_folder)


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
