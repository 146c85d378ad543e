"""A run on the simulated lab, small enough to observe in a test, and its recording."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from observer.calibration.formats.opencv_file import calibration_text
from observer.opening import OpenedSource, open_source
from observer.recording.payloads import Anchor, Images, RunFacts
from observer.recording.writer import RecordingWriter
from observer.sources.contract import Source
from observer.truth.contract import Truth
from observer.truth.sampled import TruthSample
from observer.types import StereoFrame

FRAMES = 24


@pytest.fixture(scope="session")
def lab() -> Iterator[OpenedSource]:
    """The simulated lab, for its metadata and truth."""
    opened = open_source("simulated:lab")
    yield opened
    opened.source.close()


@pytest.fixture(scope="session")
def frames(lab: OpenedSource) -> tuple[StereoFrame, ...]:
    """Its first frames, received 1/15 s apart."""
    begin = time.monotonic()
    found: list[StereoFrame] = []
    while len(found) < FRAMES:
        frame = lab.source.read()
        assert isinstance(frame, StereoFrame)
        fields = {name: getattr(frame, name) for name in frame.__dataclass_fields__}
        found.append(StereoFrame(**{**fields, "received": begin + frame.time}))
    return tuple(found)


def facts_of(source: Source, images: Images = "lossless", anchor: Anchor | None = None) -> RunFacts:
    """Return what the engine knows when a run on this source begins."""
    assert source.calibration is not None
    mount = source.info.mount
    return RunFacts(
        id="0123",
        name="a run",
        source=source.info.spec,
        info=asdict(source.info),
        calibration_yaml=calibration_text(source.calibration),
        mount=None if mount is None else asdict(mount),
        preset="default",
        versions={"dynamic-observer": "0.1.0"},
        images=images,
        anchor=anchor or Anchor.now(),
    )


@pytest.fixture
def facts(lab: OpenedSource, frames: tuple[StereoFrame, ...]) -> Callable[[Images], RunFacts]:
    """Make the facts of a run that begins with the first frame."""
    anchor = Anchor(time.time_ns(), frames[0].received)
    return lambda images: facts_of(lab.source, images, anchor)


@pytest.fixture
def line() -> Callable[[StereoFrame], dict[str, Any]]:
    """Make a line with one obstacle, as the observer might report it."""
    return made_up_line


def truth_at(truth: Truth, frame: StereoFrame) -> TruthSample:
    """Return the truth at a frame."""
    return TruthSample(
        frame.index, frame.time, truth.bodies(frame.time), truth.camera_pose(frame.time)
    )


@pytest.fixture
def write_run(
    lab: OpenedSource, frames: tuple[StereoFrame, ...], facts: Callable[[Images], RunFacts]
) -> Callable[..., Path]:
    """Write frames and made-up lines, and return the path."""

    def write(path: Path, images: Images = "lossless", *, finish: bool = True) -> Path:
        with path.open("wb", buffering=0) as file:
            writer = RecordingWriter(file, facts(images))
            for frame in frames:
                writer.frame(frame)
                writer.observation(made_up_line(frame), frame.received)
                assert lab.truth is not None
                writer.truth(truth_at(lab.truth, frame), frame.received)
                if frame.index % 6 == 5:
                    # A later time makes the writer flush now.
                    writer.flush(time.monotonic() + 10.0)
            if finish:
                writer.finish()
            else:
                # As if it were killed right after it wrote a chunk.
                writer.flush(time.monotonic() + 10.0)
        return path

    return write


def made_up_line(frame: StereoFrame) -> dict[str, Any]:
    """Return a line with one obstacle, as the observer might report it for this frame."""
    obstacle = {
        "id": 3,
        "state": "confirmed",
        "motion": "moving",
        "position": [0.1, 0.2, 3.0 + frame.time],
        "velocity": [0.0, 0.0, 1.0],
        "speed": 1.0,
        "speed_std": 0.05,
        "position_cov": [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.04]],
        "velocity_cov": None,
        "velocity_time": frame.time,
        "size": [0.5, 1.7, 0.4],
        "orientation_wxyz": [1.0, 0.0, 0.0, 0.0],
        "range": 3.0,
        "bearing": 0.0333,
        "closing_speed": None,
        "points": 17,
        "significance": 9.5,
        "box_px": [10.0, 20.0, 60.0, 90.0],
        "why": "it moves",
        "silhouette": [[[12, 20], [60, 25], [55, 90]], [[10, 80], [14, 80], [14, 88]]],
    }
    return {
        "frame": frame.index,
        "time": frame.time,
        "segment": 0,
        "status": "ok",
        "reasons": [],
        "parameters_revision": 1,
        "pose": {"position": [0.0, 0.0, 0.1 * frame.time], "orientation_wxyz": [1.0, 0, 0, 0]},
        "obstacles": [obstacle],
        "unseen": {"share": 0.25, "causes": {"dark": 0.25}, "cell_px": 16, "rows": ["d.", ".."]},
        "timings_ms": {"total": 12.5},
    }
