"""A short run over the simulated lab, recorded as the engine does."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from app.reports.report import Report, make_report
from observer.calibration.formats.opencv_file import calibration_text
from observer.jsonl import observation_line
from observer.observer import Observer
from observer.opening import open_source
from observer.parameters import Parameters
from observer.recording.payloads import (
    Anchor,
    Images,
    Incident,
    ParameterRevision,
    RobotRow,
    RunFacts,
)
from observer.recording.writer import RecordingWriter
from observer.truth.sampled import TruthSample
from observer.types import StereoFrame

FRAMES = 12


def record(
    path: Path,
    *,
    images: Images = "jpeg",
    truth: bool = True,
    frames: int = FRAMES,
    sent: tuple[float, str] = (-0.4, "moving"),
    slower: float = 1.0,
    clouds: bool = False,
) -> Path:
    """Observe the lab from its beginning and write what happens; the command is made up.

    Args:
        sent: m/s, to a robot in this state.
        slower: factor to real time, as frames come on a busy machine.
        clouds: keep a made-up cloud with every third frame.
    """
    opened = open_source("simulated:lab")
    source, calibration = opened.source, opened.source.calibration
    assert calibration is not None
    begin = time.monotonic()
    anchor = Anchor(1_700_000_000_000_000_000, begin)
    mount = source.info.mount
    facts = RunFacts(
        id="20260101-120000-abcdef", name="a <short> run", source="simulated:lab",
        info=asdict(source.info), calibration_yaml=calibration_text(calibration), images=images,
        mount=None if mount is None else asdict(mount), preset="default",
        versions={"dynamic-observer": "0.1.0"}, anchor=anchor,
    )  # fmt: skip
    observer = Observer(calibration, mount=source.info.mount)
    writer = RecordingWriter(path, facts)
    values = Parameters().flat()
    writer.parameters(ParameterRevision(revision=1, values=values), begin)
    changed = {"flow.residual_threshold_px": 1.25}
    for number in range(frames):
        frame = source.read()
        assert isinstance(frame, StereoFrame)
        received = begin + slower * frame.time
        if number == 9:
            revision = ParameterRevision(
                revision=2, values={**values, **changed}, frame=frame.index, difference=changed
            )
            writer.parameters(revision, received)
        fields = {name: getattr(frame, name) for name in frame.__dataclass_fields__}
        frame = StereoFrame(**{**fields, "received": received})
        writer.frame(frame)
        writer.observation(observation_line(observer.observe(frame)), received)
        if clouds and number % 3 == 0:
            points = np.random.default_rng(number).uniform(0.5, 3.0, (500, 3)).astype(np.float32)
            writer.cloud(points, np.full((500, 3), 90, np.uint8), received)
        if truth:
            assert opened.truth is not None
            bodies, pose = opened.truth.bodies(frame.time), opened.truth.camera_pose(frame.time)
            writer.truth(TruthSample(frame.index, frame.time, bodies, pose), received)
            row = RobotRow(
                role="obstacle",
                received=received,
                time=frame.time,
                sent_speed=sent[0],
                facts={"state": sent[1]},
            )
            writer.robot(row)
    writer.incident(Incident(kind="stop", sentence="A <guard> stop.", received=received))
    writer.finish()
    source.close()
    return path


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording with images and truth."""
    return record(tmp_path_factory.mktemp("report") / "recording.mcap")


@pytest.fixture(scope="session")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording with neither images nor truth."""
    path = tmp_path_factory.mktemp("bare") / "recording.mcap"
    return record(path, images="none", truth=False, frames=6)


@pytest.fixture(scope="session")
def report(recording: Path) -> Report:
    """The report of the run with images and truth."""
    return make_report(recording, lambda _done, _of: None)
