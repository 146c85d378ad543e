"""Two short sources with truth: a stereo folder and a recording."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict
from pathlib import Path

import pytest

from observer.calibration.formats.opencv_file import calibration_text
from observer.opening import open_source
from observer.recording.payloads import Anchor, RunFacts
from observer.recording.writer import RecordingWriter
from observer.simulation.export import export_stereo_folder
from observer.truth.sampled import TruthSample
from observer.types import StereoFrame

# Seconds: long enough to find obstacles, which count from 0.6 s on, at 15 frames a second.
SECONDS = 1.2
RECORDED = 15


@pytest.fixture(scope="session")
def sources(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """Make a stereo folder and record its first frames; painting a second world would take long."""
    home = tmp_path_factory.mktemp("sweep")
    scenario = home / "short.yaml"
    scenario.write_text(f"based_on: lateral\nduration_s: {SECONDS}\n")
    export_stereo_folder(str(scenario), 1, home / "one")
    recording = home / "two.mcap"
    _record(home / "one", recording)
    return str(home / "one"), str(recording)


def _record(folder: Path, path: Path) -> None:
    opened = open_source(str(folder))
    with closing(opened.source) as source, path.open("wb", buffering=0) as file:
        assert source.calibration is not None
        assert opened.truth is not None
        facts = RunFacts(
            id="2",
            name="two",
            source=source.info.spec,
            info=asdict(source.info),
            calibration_yaml=calibration_text(source.calibration),
            mount=None,
            preset="default",
            versions={},
            images="lossless",
            anchor=Anchor.now(),
        )
        writer = RecordingWriter(file, facts)
        while isinstance(frame := source.read(), StereoFrame) and frame.index < RECORDED:
            writer.frame(frame)
            truth = opened.truth
            seen = TruthSample(
                frame.index, frame.time, truth.bodies(frame.time), truth.camera_pose(frame.time)
            )
            writer.truth(seen, frame.received)
        writer.finish()


@pytest.fixture
def copied(sources: tuple[str, str], tmp_path: Path) -> Callable[..., str]:
    """Copy the stereo folder without one of its files and return its path."""

    def copy(name: str, without: str = "") -> str:
        folder = tmp_path / name
        for path in Path(sources[0]).rglob("*"):
            if path.is_file() and path.name != without:
                target = folder / path.relative_to(sources[0])
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(path.read_bytes())
        return str(folder)

    return copy
