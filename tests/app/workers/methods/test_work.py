"""The same frames observed with two methods, in this process."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from app.workers.methods.messages import FRAMES, SPEEDS, Compared, CompareMethods, NewRun
from app.workers.methods.work import compare
from observer.errors import CalibrationError, SourceError
from observer.navigation.parameters import AllParameters
from observer.parameters import preset
from observer.recording.reader import Recording

_JOB = CompareMethods(
    source="simulated:people",
    seconds=1.0,
    newest=False,
    calibration_yaml=None,
    rig_yaml=None,
    versions={},
    picture="",
    runs=(),
)


def _told(words: str, share: float) -> None:
    assert words
    assert 0 <= share <= 1


def _job(folder: Path, presets: tuple[str, ...], base: CompareMethods = _JOB) -> CompareMethods:
    runs = []
    for number, name in enumerate(presets):
        path = folder / name
        path.mkdir(parents=True)
        values = AllParameters().changed(preset(name).flat()).flat()
        images = "none" if number else "lossless"
        runs.append(NewRun(str(path), name, f"people, {name}", name, values, images))  # type: ignore[arg-type]
    return replace(base, picture=str(folder / "picture.jpg"), runs=tuple(runs))


# Fields from which the server makes rows of speeds.
KEPT = ("id", "state", "velocity_time", "speed", "speed_std")


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Compared]:
    folder = tmp_path_factory.mktemp("compared")
    threads = cv2.getNumThreads()
    try:
        return folder, compare(_job(folder, ("paper", "default")), _told)
    finally:
        cv2.setNumThreads(threads)


def test_every_frame_is_processed_by_both_methods(compared: tuple[Path, Compared]) -> None:
    folder, done = compared
    assert (done.frames, done.segments, done.begin_s) == (15, (1, 1), 0.0)
    assert done.duration_s == pytest.approx(14 / 15)
    for name in ("paper", "default"):
        with Recording(folder / name / "recording.mcap") as recording:
            lines, frames = list(recording.lines()), recording.frames
            assert [line["frame"] for line in lines] == list(range(15))
            # Log times advance like the source's clock.
            received = np.array([frame.received for frame in frames])
            assert np.diff(received) == pytest.approx(np.full(14, 1 / 15), abs=1e-6)
            assert recording.truth() is not None
        found = json.loads((folder / name / FRAMES).read_text())["frames"]
        speeds = [json.loads(each) for each in (folder / name / SPEEDS).read_text().splitlines()]
        for line, entry, told in zip(lines, found, speeds, strict=True):
            assert [each["id"] for each in entry["obstacles"]] == [
                each["id"] for each in line["obstacles"]
            ]
            assert told["obstacles"] == [
                {name: dict(each)[name] for name in KEPT} for each in line["obstacles"]
            ]
            assert len(entry["truth"]) == 3
    picture = cv2.imread(str(folder / "picture.jpg"))
    assert picture is not None
    assert picture.shape == (256, 1024, 3)


def test_running_methods_in_threads_changes_no_result(
    compared: tuple[Path, Compared], tmp_path: Path
) -> None:
    folder, _ = compared
    images = str(folder / "paper" / "recording.mcap")
    compare(_job(tmp_path, ("default",), replace(_JOB, source=images)), _told)
    told = []
    for path in (folder, tmp_path):
        with Recording(path / "default" / "recording.mcap") as recording:
            told.append([(line["pose"], line["obstacles"]) for line in recording.lines()])
    assert told[0] == told[1]


def test_the_last_seconds_of_a_clip_are_used(
    compared: tuple[Path, Compared], tmp_path: Path
) -> None:
    folder, _ = compared
    clip = replace(_JOB, source=str(folder / "paper" / "recording.mcap"), seconds=0.2, newest=True)
    done = compare(_job(tmp_path, ("paper",), clip), _told)
    assert done.frames == 3
    with Recording(tmp_path / "paper" / "recording.mcap") as recording:
        assert [frame.index for frame in recording.frames] == [12, 13, 14]


def test_an_unusable_source_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SourceError):
        compare(_job(tmp_path / "a", ("paper",), replace(_JOB, source="nowhere")), _told)
    bare = replace(_JOB, source="simulated:webcams")
    with pytest.raises(CalibrationError, match="calibrate its cameras"):
        compare(_job(tmp_path / "b", ("paper",), bare), _told)
