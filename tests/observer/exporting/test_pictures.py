"""Videos, point clouds and the archive of everything, read back by independent means."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest

from observer.exporting.archive import write_archive
from observer.exporting.clouds import Cloud, cloud_at, write_ply
from observer.exporting.errors import ExportError
from observer.exporting.output import whole_output
from observer.exporting.overlay import draw_overlay
from observer.exporting.run_video import write_run_video
from observer.exporting.video import OverlayVideo
from observer.jsonl import line_pose
from observer.obstacle_colors import OBSTACLE_RGB
from observer.recording.reader import Recording

from .conftest import FRAMES


def pictures_of(path: Path) -> list[np.ndarray]:
    """Return all frames of a video."""
    capture = cv2.VideoCapture(str(path))
    found = []
    while True:
        there, picture = capture.read()
        if not there:
            break
        found.append(picture)
    capture.release()
    return found


def encoders() -> list[str | None]:
    """Return OpenCV's own encoder, and ffmpeg where it is installed."""
    return [None, *([found] if (found := shutil.which("ffmpeg")) else [])]


@pytest.mark.parametrize("ffmpeg", encoders())
def test_video_frames_follow_their_times_and_gaps_are_filled(
    tmp_path: Path, ffmpeg: str | None
) -> None:
    path = tmp_path / "a %20 video.mp4.part"
    video = OverlayVideo(path, 10.0, ffmpeg=ffmpeg)
    shades = [30, 90, 150, 210]
    # One frame is missing after the second, and the clock restarts before the last.
    for shade, time in zip(shades, (5.0, 5.1, 5.3, 0.0), strict=True):
        video.add(np.full((65, 97, 3), shade, np.uint8), time)
    video.finish()
    assert [each.name for each in tmp_path.iterdir()] == [path.name]
    found = pictures_of(path)
    assert found[0].shape == (64, 96, 3)
    assert video.pictures == 5
    means = [float(picture.mean()) for picture in found]
    assert means == pytest.approx([30, 90, 90, 150, 210], abs=6)


@pytest.mark.parametrize("ffmpeg", encoders())
def test_a_video_that_cannot_be_written_is_reported(tmp_path: Path, ffmpeg: str | None) -> None:
    video = OverlayVideo(tmp_path / "none" / "v.mp4", 10.0, ffmpeg=ffmpeg)

    def write() -> None:
        try:
            for k in range(50):
                video.add(np.zeros((480, 640, 3), np.uint8), k / 10)
            video.finish()
        finally:
            video.abort()

    with pytest.raises(ExportError, match="cannot be written"):
        write()


def test_the_video_of_a_run_shows_each_frame_with_its_obstacles(
    recorded: dict[str, Path], tmp_path: Path
) -> None:
    with Recording(recorded["lossless"]) as recording:
        write_run_video(recording, tmp_path / "v.mp4")
        found = pictures_of(tmp_path / "v.mp4")
        assert len(found) == FRAMES
        line = list(recording.lines())[-1]
        left, _ = recording.pair(FRAMES - 1)
        before = left.copy()
        drawn = draw_overlay(left, line)
        assert np.array_equal(left, before)
        u0, v0, _, v1 = (round(value) for value in line["obstacles"][0]["box_px"])
        assert drawn[(v0 + v1) // 2, u0].tolist() == list(OBSTACLE_RGB["moving"][::-1])
        # First as a recording made before silhouettes existed, then with one: its inside is tinted.
        older = dict(line["obstacles"][0])
        older.pop("silhouette")
        plain = draw_overlay(left, {**line, "obstacles": [older]})
        square = [[u0 + 5, v0 + 5], [u0 + 15, v0 + 5], [u0 + 15, v0 + 15], [u0 + 5, v0 + 15]]
        shown = draw_overlay(left, {**line, "obstacles": [{**older, "silhouette": [square]}]})
        changed = (plain != shown).any(axis=2)
        assert changed[v0 + 10, u0 + 10]
        assert not changed[: v0 + 3].any()
        assert not changed[:, : u0 + 3].any()
        # The same place in the encoded video is red too: green and blue are far below.
        blue, green, red = found[-1][(v0 + v1) // 2, u0].astype(int)
        assert red > max(green, blue) + 60
    with (
        Recording(recorded["none"]) as recording,
        pytest.raises(ExportError, match="without images"),
    ):
        write_run_video(recording, tmp_path / "w.mp4")


def read_ply(data: bytes) -> np.ndarray:
    """Return the vertices of a PLY, parsed by its own header."""
    header, _, body = data.partition(b"end_header\n")
    lines = header.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    kinds = {"float": "<f4", "uchar": "u1"}
    fields = [line.split() for line in lines if line.startswith("property")]
    found = np.frombuffer(body, [(name, kinds[kind]) for _, kind, name in fields])
    assert f"element vertex {len(found)}" in lines
    return found


def test_a_recorded_cloud_is_used_and_a_missing_one_is_computed(recorded: dict[str, Path]) -> None:
    with Recording(recorded["jpeg"]) as recording:
        kept = cloud_at(recording, 5)
        assert kept.source == "recorded"
        assert np.array_equal(kept.points.ravel(), np.arange(15))
        assert kept.colors.tolist() == [[9, 8, 7]] * 5
        made = cloud_at(recording, 0)
        assert made.source == "computed"
        assert len(made.points) > 10_000
        # The lab is a few metres across, and a few wrong matches are always far away.
        near, far = np.quantile(made.points[:, 2], [0.01, 0.99])
        assert 0.3 < near < 3 < far < 20
        turned = cloud_at(recording, FRAMES - 1, "world")
        pose = line_pose(list(recording.lines())[-1])
        assert pose is not None
        assert np.linalg.norm(pose.translation) > 1e-4
        there = cloud_at(recording, FRAMES - 1).points
        assert np.abs(turned.points - pose.apply(there)).max() < 1e-5
        with pytest.raises(ExportError, match=f"0 to {FRAMES - 1}"):
            cloud_at(recording, FRAMES)


def test_ply_holds_every_point() -> None:
    rng = np.random.default_rng(3)
    points = rng.normal(size=(100, 3)).astype(np.float32)
    colors = rng.integers(0, 255, (100, 3), dtype=np.uint8)
    file = io.BytesIO()
    write_ply(Cloud(points, colors, "camera", "computed", 7, 0.5), file)
    read = read_ply(file.getvalue())
    assert np.array_equal(np.stack([read[c] for c in "xyz"], axis=1), points)
    names = ("red", "green", "blue")
    assert np.array_equal(np.stack([read[c] for c in names], axis=1), colors)


def test_the_archive_holds_everything_and_names_what_is_missing(
    recorded: dict[str, Path], tmp_path: Path
) -> None:
    for images in ("jpeg", "none"):
        with Recording(recorded[images]) as recording:
            write_archive(recording, tmp_path / f"{images}.zip")
    with zipfile.ZipFile(tmp_path / "jpeg.zip") as archive:
        assert archive.testzip() is None
        names = set(archive.namelist())
        readme = archive.read("README.md").decode()
        lines = archive.read("observations.jsonl").decode().splitlines()
        assert len(lines) == FRAMES
        assert json.loads(archive.read("run.json"))["id"] == "jpeg"
        header = archive.read("obstacles.csv").decode().splitlines()[0].split(",")
        assert all(f"- {column} (" in readme for column in header)
        assert len(read_ply(archive.read("cloud.ply"))) > 10_000
        poses = archive.read("camera.tum").decode().splitlines()[2:]
        assert len(poses) == FRAMES
        assert all(len(pose.split()) == 8 for pose in poses)
    assert {"overlay.mp4", "calibration.yaml", "truth.csv", "odometry.csv", "frames.csv"} < names
    with zipfile.ZipFile(tmp_path / "none.zip") as archive:
        assert "overlay.mp4" not in archive.namelist()
        assert "overlay.mp4: none.mcap was recorded without images" in (
            archive.read("README.md").decode()
        )
    assert sorted(each.name for each in tmp_path.iterdir()) == ["jpeg.zip", "none.zip"]


def test_an_archive_may_hold_more_lines_than_fit_into_a_plain_zip(
    recorded: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zipfile, "ZIP64_LIMIT", 1000)
    with Recording(recorded["none"]) as recording:
        write_archive(recording, tmp_path / "run.zip")
        expected = len(list(recording.lines()))
    with zipfile.ZipFile(tmp_path / "run.zip") as archive:
        assert len(archive.read("observations.jsonl").splitlines()) == expected


def test_a_file_is_replaced_only_on_request_and_only_as_a_whole(tmp_path: Path) -> None:
    path = tmp_path / "f.csv"
    path.write_text("before")
    with pytest.raises(ExportError, match="--overwrite"), whole_output(path):
        pass
    with contextlib.suppress(KeyError), whole_output(path, overwrite=True) as part:
        part.write_text("half")
        raise KeyError
    assert path.read_text() == "before"
    with whole_output(path, overwrite=True) as part:
        part.write_text("after")
    assert path.read_text() == "after"
    assert [each.name for each in tmp_path.iterdir()] == ["f.csv"]
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis").touch()
    with (
        pytest.raises(ExportError, match="not a bag"),
        whole_output(tmp_path / "mine", overwrite=True),
    ):
        pass
    with (
        pytest.raises(ExportError, match="existing, writable folder"),
        whole_output(tmp_path / "no" / "f.csv"),
    ):
        pass
