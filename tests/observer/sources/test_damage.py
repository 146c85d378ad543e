"""Damaged folders of stereo images and videos: frames in order, or one sentence."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from observer.errors import InputError, SourceError
from observer.sources.contract import SkippedFrame, Source
from observer.sources.euroc import read_image_list
from observer.sources.folders import open_folder
from observer.sources.kitti import read_timestamps_ns
from observer.sources.video import open_video
from observer.types import StereoFrame

from ...damage import (
    assert_one_sentence,
    damaged,
    examples,
    hostile_bytes,
    read_or_refused,
)
from .conftest import marked_image, write_image
from .test_video import KINDS, image, jpeg, write_video

FRAMES = 4
TIMES = "".join(f"{k / 15:.6f}\n" for k in range(FRAMES))
STAMPS = "".join(f"2011-09-26 14:06:{k:02d}.052646144\n" for k in range(FRAMES))
EUROC = "#timestamp [ns],filename\n" + "".join(
    f"{1403636579763555584 + k * 50_000_000},{k}.png\n" for k in range(FRAMES)
)
SENSOR = """sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: [1, 0, 0, {x}, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
resolution: [64, 48]
camera_model: pinhole
intrinsics: [58.0, 57.0, 32.0, 24.0]
distortion_model: radial-tangential
distortion_coefficients: [0, 0, 0, 0]
"""
KITTI = "".join(f"P{i}: 70 0 32 {-38 * (i % 2)} 0 70 24 0 0 0 1 0\n" for i in range(2))

Layout = tuple[tuple[str, str], dict[str, str]]
# Image folders, and the files that describe them.
LAYOUTS: dict[str, Layout] = {
    "stereo folder": (("left", "right"), {"times.txt": TIMES}),
    "KITTI odometry": (("image_0", "image_1"), {"times.txt": TIMES, "calib.txt": KITTI}),
    "KITTI raw": (
        ("image_00/data", "image_01/data"),
        {"image_00/timestamps.txt": STAMPS, "image_01/timestamps.txt": STAMPS},
    ),
    "EuRoC": (
        ("mav0/cam0/data", "mav0/cam1/data"),
        {
            "mav0/cam0/data.csv": EUROC, "mav0/cam1/data.csv": EUROC,
            "mav0/cam0/sensor.yaml": SENSOR.format(x=0),
            "mav0/cam1/sensor.yaml": SENSOR.format(x=0.11),
        },
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def laid_out(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    made: dict[str, Path] = {}

    def lay_out(kind: str) -> Path:
        if kind not in made:
            root = made[kind] = tmp_path_factory.mktemp("layout")
            for side, folder in zip(("left", "right"), LAYOUTS[kind][0], strict=True):
                for k in range(FRAMES):
                    write_image(root / folder / f"{k}.png", marked_image(k, side))
        for name, text in LAYOUTS[kind][1].items():
            (made[kind] / name).write_text(text)
        return made[kind]

    return lay_out


@pytest.mark.parametrize("kind", LAYOUTS)
def test_intact_layouts_are_read(laid_out: Callable[[str], Path], kind: str) -> None:
    source = open_folder(laid_out(kind))
    assert source.info.kind == kind
    assert sum(isinstance(source.read(), StereoFrame) for _ in range(FRAMES)) == FRAMES


@pytest.mark.parametrize("kind", LAYOUTS)
@examples(24)
@given(data=st.data())
def test_damaged_tables_are_refused_or_frames_are_in_order(
    laid_out: Callable[[str], Path], kind: str, data: st.DataObject
) -> None:
    root = laid_out(kind)
    name = data.draw(st.sampled_from(sorted(LAYOUTS[kind][1])))
    (root / name).write_bytes(data.draw(damaged([LAYOUTS[kind][1][name].encode()])))
    source = read_or_refused(lambda: open_folder(root), InputError)
    if source is None:
        return
    assert_in_order(source)
    if source.calibration is not None:
        assert source.calibration.baseline > 0


def assert_in_order(source: Source, most: int = 200) -> None:
    """Play the source to its end, and check that its frames are valid and in order."""
    size, times = (source.info.height, source.info.width), []
    for _ in range(most):
        frame = source.read()
        if frame is None:
            break
        if isinstance(frame, SkippedFrame):
            assert_one_sentence(frame.reason)
            continue
        assert isinstance(frame, StereoFrame)
        assert frame.left.shape[:2] == frame.right.shape[:2] == size
        times.append(frame.time)
    else:
        pytest.fail("it does not end")
    assert all(map(math.isfinite, times))
    assert times == sorted(set(times))


@pytest.fixture(scope="module")
def videos(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Return files of six frames by their extension, and the bare images concatenated."""
    folder = tmp_path_factory.mktemp("videos")
    images = [np.hstack([image(k, "left"), image(k, "right")]) for k in range(6)]
    made = {"mjpeg": b"".join(map(jpeg, images))}
    for codec, ending in KINDS:
        made[ending] = write_video(folder / f"whole.{ending}", images, codec=codec).read_bytes()
    return made


@pytest.mark.parametrize("ending", ["mjpeg", *(ending for _, ending in KINDS)])
@pytest.mark.parametrize("count", [1, 2], ids=["side by side", "a pair"])
@examples(12)
@given(data=st.data())
def test_a_damaged_video_is_refused_or_plays_in_order(
    tmp_path_factory: pytest.TempPathFactory,
    videos: dict[str, bytes],
    count: int,
    ending: str,
    data: st.DataObject,
) -> None:
    folder = tmp_path_factory.getbasetemp()
    whole, broken = folder / f"whole.{ending}", folder / f"damaged.{ending}"
    whole.write_bytes(videos[ending])
    samples = [videos[ending]]
    if ending == "mjpeg":
        # A complete image of another size among the others.
        at = videos[ending].rindex(b"\xff\xd8\xff")
        other = jpeg(image(0, "left", (32, 48)))
        samples.append(videos[ending][:at] + other + videos[ending][at:])
    broken.write_bytes(data.draw(damaged(samples)))
    paths = data.draw(st.permutations([whole, broken])) if count == 2 else [broken]

    def play() -> None:
        source = open_video(",".join(map(str, paths)))
        try:
            assert_in_order(source)
            source.rewind()
            source.read()
        finally:
            source.close()

    read_or_refused(play, SourceError)


@examples(60)
@given(content=damaged([STAMPS.encode()]) | hostile_bytes((b"2011-09-26 14:06:06", b".", b"\n")))
@example(b"2011-09-26 14:06:06.-5\n")
@example("2011-09-26 14:06:06.٣\n".encode())
@example(b"2011-09-26 14:06:06.1_0\n")
@example(b"0001-01-01.5\n")
def test_stamps_are_whole_nanoseconds_or_refused(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / "timestamps.txt"
    path.write_bytes(content)
    stamps = read_or_refused(lambda: read_timestamps_ns(path), SourceError)
    if stamps is not None:
        lines = [each.strip() for each in content.decode("utf-8-sig").splitlines()]
        told = [each for each in lines if each and not each.startswith("#")]
        assert len(stamps) == len(told)
        for stamp, line in zip(stamps, told, strict=True):
            fraction = line.partition(".")[2]
            assert not fraction or (fraction.isascii() and fraction.isdecimal()), line
            assert stamp % 1_000_000_000 == int(fraction[:9].ljust(9, "0"))


@examples(60)
@given(content=damaged([EUROC.encode()], (b",", b"..")) | hostile_bytes((b"14036", b",a.png")))
def test_a_list_of_images_names_files_of_its_folder_or_is_refused(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / "data.csv"
    path.write_bytes(content)
    names = read_or_refused(lambda: read_image_list(path), SourceError)
    for stamp, name in (names or {}).items():
        assert 0 <= stamp < 10**19
        assert Path(name).name == name
        assert "\0" not in name
