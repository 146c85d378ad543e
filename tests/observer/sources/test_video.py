"""Video files, two or one side by side, made here, whole and damaged."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import cv2
import numpy as np
import pytest

from observer.calibration.formats.opencv_file import calibration_text
from observer.camera import StereoCalibration
from observer.errors import CalibrationError, SourceError
from observer.opening import open_source
from observer.sources.contract import SkippedFrame
from observer.sources.video import VideoSource, open_video
from observer.types import Image, StereoFrame

RATE = 12.5
WIDTH, HEIGHT = 64, 48
# Codec and container: timestamps from the container, from an index, and lossless.
KINDS = [("MJPG", "avi"), ("mp4v", "mp4"), ("FFV1", "mkv")]


def image(number: int, side: str, size: tuple[int, int] = (WIDTH, HEIGHT)) -> Image:
    level = 20 + 10 * number + (40 if side == "right" else 0)
    return np.full((size[1], size[0], 3), level, np.uint8)


def write_video(
    path: Path, images: Iterable[Image], *, codec: str = "MJPG", rate: float = RATE
) -> Path:
    images = list(images)
    size = (images[0].shape[1], images[0].shape[0])
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), rate, size)
    assert writer.isOpened()
    for each in images:
        writer.write(each)
    writer.release()
    return path


def jpeg(image: Image) -> bytes:
    return cv2.imencode(".jpg", image)[1].tobytes()


def write_pair(folder: Path, counts: tuple[int, int] = (10, 10), extension: str = "avi",
               codec: str = "MJPG") -> str:  # fmt: skip
    left, right = (
        write_video(
            folder / f"{side}.{extension}", (image(k, side) for k in range(count)), codec=codec
        )
        for side, count in zip(("left", "right"), counts, strict=True)
    )
    return f"{left},{right}"


def played(source: VideoSource) -> list[StereoFrame | SkippedFrame]:
    result: list[StereoFrame | SkippedFrame] = []
    try:
        while (item := source.read()) is not None:
            result.append(item)
            assert len(result) < 200
    finally:
        source.close()
    return result


def assert_is(frame: object, number: int) -> None:
    assert isinstance(frame, StereoFrame)
    assert frame.index == number
    assert frame.left.shape == frame.right.shape == (HEIGHT, WIDTH, 3)
    assert frame.left.mean() == pytest.approx(20 + 10 * number, abs=4)
    assert frame.right.mean() - frame.left.mean() == pytest.approx(40, abs=4)
    assert frame.time == pytest.approx(number / RATE, abs=1e-3)


@pytest.mark.parametrize(("codec", "extension"), KINDS)
def test_two_files_play_as_pairs(codec: str, extension: str, tmp_path: Path) -> None:
    source = open_video(write_pair(tmp_path, extension=extension, codec=codec))
    assert source.info.kind == "video"
    assert (source.info.width, source.info.height) == (WIDTH, HEIGHT)
    assert source.info.frame_rate == pytest.approx(RATE)
    assert source.info.frame_count == 10
    assert source.calibration is None
    seen = played(source)
    assert len(seen) == 10
    for number, frame in enumerate(seen):
        assert_is(frame, number)


def side_by_side(folder: Path) -> Path:
    images = (np.hstack([image(k, "left"), image(k, "right")]) for k in range(10))
    return write_video(folder / "both, side by side.mkv", images, codec="FFV1")


def test_one_file_plays_side_by_side(tmp_path: Path) -> None:
    source = open_video(str(side_by_side(tmp_path)))
    assert (source.info.width, source.info.height) == (WIDTH, HEIGHT)
    seen = played(source)
    assert len(seen) == 10
    for number, frame in enumerate(seen):
        assert_is(frame, number)
        assert isinstance(frame, StereoFrame)
        assert frame.left.flags["C_CONTIGUOUS"]
        assert frame.right.flags["C_CONTIGUOUS"]


def test_rewind_restarts_the_video(tmp_path: Path) -> None:
    source = open_video(write_pair(tmp_path))
    for _ in range(3):
        source.read()
    source.rewind()
    assert_is(source.read(), 0)
    played(source)
    source.rewind()
    assert_is(source.read(), 0)
    source.close()
    source.close()
    assert source.read() is None


def test_a_video_opens_by_its_spec(tmp_path: Path) -> None:
    opened = open_source("video:" + write_pair(tmp_path))
    assert opened.truth is None
    assert opened.source.info.spec.startswith("video:")
    assert_is(opened.source.read(), 0)
    opened.source.close()


def test_the_calibration_beside_a_video_is_used(tmp_path: Path) -> None:
    made = StereoCalibration.rectified(WIDTH, HEIGHT, 60.0, 60.0, 31.5, 23.5, 0.12)
    (tmp_path / "calibration.yaml").write_text(calibration_text(made))
    source = open_video(str(side_by_side(tmp_path)))
    assert source.calibration is not None
    assert source.calibration.baseline == 0.12
    source.close()
    other = StereoCalibration.rectified(2 * WIDTH, HEIGHT, 60.0, 60.0, 31.5, 23.5, 0.12)
    (tmp_path / "calibration.yaml").write_text(calibration_text(other))
    with pytest.raises(CalibrationError, match="128x48 pixels, but the video's are 64x48"):
        open_video(str(tmp_path / "both, side by side.mkv"))


def test_unequal_counts_are_reported_frame_by_frame(tmp_path: Path) -> None:
    seen = played(open_video(write_pair(tmp_path, (10, 8))))
    assert len(seen) == 10
    assert_is(seen[7], 7)
    for number in (8, 9):
        item = seen[number]
        assert isinstance(item, SkippedFrame)
        assert item.index == number
        assert item.reason.startswith(f"right.avi ends before frame {number}")


def test_a_truncated_video_reports_how_much_is_missing(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (30, HEIGHT, 2 * WIDTH, 3), dtype=np.uint8)
    path = write_video(tmp_path / "both.avi", noise)
    content = path.read_bytes()
    source = open_video(str(path))
    assert source.info.frame_count == 30
    assert len(played(source)) == 30
    # The header of an AVI comes first, so it still announces all frames.
    path.write_bytes(content[: len(content) // 2])
    seen = played(open_video(str(path)))
    assert isinstance(seen[-1], SkippedFrame)
    assert "should have 30 frames but ends after" in seen[-1].reason
    assert 5 < len(seen) < 20


def test_a_video_without_timestamps_is_timed_by_its_rate(
    tmp_path: Path,
) -> None:
    # A raw MJPEG stream has neither an index nor timestamps.
    path = tmp_path / "both.mjpeg"
    pairs = (np.hstack([image(k, "left"), image(k, "right")]) for k in range(8))
    path.write_bytes(b"".join(map(jpeg, pairs)))
    source = open_video(str(path))
    seen = played(source)
    assert len(seen) == 8
    times = [frame.time for frame in seen if isinstance(frame, StereoFrame)]
    assert np.diff(times) == pytest.approx(1 / source.info.frame_rate)


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda p: f"{p}/absent.mp4", r"there is no video file .*absent\.mp4"),
        (lambda p: f"{write_video(p / 'left.avi', [image(0, 'left')] * 3)},{p}/absent.mp4",
         r"there is no video file .*absent\.mp4"),
        (lambda _p: "", "video: needs a file"),
        (lambda p: f"{p}/a.mp4,{p}/b.mp4,{p}/c.mp4", "two files separated by a comma .* not 3"),
        (str, "there is no video file"),
        (lambda p: str(write_video(p / "one.avi", [image(0, "left")])), "fewer than two frames"),
    ],
)  # fmt: skip
def test_an_unusable_spec_is_refused(
    make: Callable[[Path], str], expected: str, tmp_path: Path
) -> None:
    with pytest.raises(SourceError, match=expected) as caught:
        open_video(make(tmp_path))
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_a_video_is_refused(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for name, content in (("note.mp4", b"no video"), ("empty.mp4", b""), ("text.mkv", b"x" * 999)):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(SourceError, match=rf"{name} is truncated or not a video"):
            open_video(str(tmp_path / name))
    capfd.readouterr()  # FFmpeg's own words


def test_mismatched_files_are_refused(tmp_path: Path) -> None:
    left = write_video(tmp_path / "left.avi", [image(k, "left") for k in range(5)])
    small = write_video(tmp_path / "small.avi", [image(k, "left", (32, 48)) for k in range(5)])
    fast = write_video(tmp_path / "fast.avi", [image(k, "right") for k in range(5)], rate=25)
    with pytest.raises(SourceError, match=r"left\.avi is 64x48 pixels and small\.avi 32x48"):
        open_video(f"{left},{small}")
    with pytest.raises(SourceError, match=r"left\.avi has 12\.5 fps and fast\.avi 25"):
        open_video(f"{left},{fast}")


def test_an_odd_width_side_by_side_is_refused(tmp_path: Path) -> None:
    odd = tmp_path / "odd.mjpeg"
    odd.write_bytes(4 * jpeg(image(0, "left", (65, 48))))
    with pytest.raises(SourceError, match=r"odd\.mjpeg is 65 pixels wide"):
        open_video(str(odd))
