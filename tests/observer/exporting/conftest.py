"""A short run on the simulated lab, really observed and recorded, made once for all tests."""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from observer.calibration.formats.opencv_file import calibration_text
from observer.jsonl import observation_line
from observer.observer import Observer
from observer.occupancy import OccupancyMap
from observer.opening import open_source
from observer.parameters import Parameters
from observer.recording.payloads import (
    Anchor,
    Images,
    LocalMapPayload,
    ParameterRevision,
    RobotRow,
    RunFacts,
)
from observer.recording.writer import RecordingWriter
from observer.truth.sampled import TruthSample
from observer.types import StereoFrame

FRAMES = 12
GOAL = {
    "state": "driving", "sentence": "Passing behind obstacle 3.", "place": [2.0, -0.5],
    "distance_m": 2.06, "elapsed_s": 1.0, "path": [[0.1, 0.0]], "risk_per_metre": 0.001,
    "planned_risk_per_metre": 2e-5, "waits_for": 3, "meets_s": 1.4, "meets_at": [1.2, 0.1],
    "refused": [
        {
            "direction": 0.3, "speed_mps": 0.5, "path": [[0.1, 0.0], [1.0, 0.3]], "cause": "risk",
            "risk": 0.04, "track": 3, "meets_s": 1.2, "guard": None,
        }
    ],
}  # fmt: skip
CELLS = np.array([[0, 0, 1], [1, 1, 2], [2, 0, 1]], np.uint8)


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """``jpeg``, ``lossless`` and ``none``: the same run with a parked cloud, truth and a log."""
    folder = tmp_path_factory.mktemp("runs")
    opened = open_source("simulated:drive")
    source, truth = opened.source, opened.truth
    assert source.calibration is not None
    assert truth is not None
    mount = source.info.mount
    anchor = Anchor(1_700_000_000_000_000_000, 50.0)
    kinds: tuple[Images, ...] = ("jpeg", "lossless", "none")
    paths = {images: folder / f"{images}.mcap" for images in kinds}
    writers = [
        RecordingWriter(
            paths[images],
            RunFacts(
                id=images,
                name=f"a run with {images}",
                source=source.info.spec,
                info=asdict(source.info),
                calibration_yaml=calibration_text(source.calibration),
                mount=None if mount is None else asdict(mount),
                images=images,
                anchor=anchor,
            ),
        )
        for images in kinds
    ]
    parameters = Parameters()
    observer = Observer(source.calibration, parameters, mount=mount)
    revision = ParameterRevision(revision=0, values=parameters.flat())
    points = np.arange(15, dtype=np.float32).reshape(5, 3)
    for writer in writers:
        writer.parameters(revision, 50.0)
    for k in range(FRAMES):
        frame = source.read()
        assert isinstance(frame, StereoFrame)
        # Observed at a third of real time.
        frame = replace(frame, received=50.0 + 3 * frame.time)
        line = observation_line(observer.observe(frame))
        sample = TruthSample(
            frame.index, frame.time, truth.bodies(frame.time), truth.camera_pose(frame.time)
        )
        bodies = [
            {
                **{name: getattr(body, name) for name in ("id", "name", "role", "yaw")},
                "position": body.position.tolist(),
                "velocity": body.velocity.tolist(),
                "speed": float(np.linalg.norm(body.velocity)),
                "size": body.size.tolist(),
                "visible": body.visible,
                "commanded_speed": None,
                "track_id": 1 if body.role == "obstacle" else None,
            }
            for body in sample.bodies
        ]
        for writer in writers:
            # Without a position at first, as of a live source.
            within = {} if k < 2 else {"source_position": k % 5, "source_time": 0.1 * (k % 5)}
            writer.frame(frame, **within)  # type: ignore[arg-type]
            writer.observation(line, frame.received, truth=bodies)
            writer.truth(sample, frame.received)
            row = RobotRow(role="observer", received=frame.received, encoder_speed=0.2)
            writer.robot(msgspec.structs.replace(row, facts={"goal": GOAL}))
            if k % 8 == 0:
                cells = OccupancyMap.of(CELLS, (-0.3, 0.1), 0.1, (0.5, 0.2, -0.1), frame.received)
                writer.local_map(LocalMapPayload(frame=frame.index, time=frame.time, map=cells))
            if k == 5:
                writer.cloud(points, np.full((5, 3), (9, 8, 7), np.uint8), frame.received)
                writer.log("warning", "engine", "it is 3 ± 1", frame.received)
    source.close()
    for writer in writers:
        writer.flush(time.monotonic() + 10)
        writer.finish()
    return {str(images): path for images, path in paths.items()}
