"""A run and its motion capture, both computed, so that they are known exactly."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from app.storage import Storage
from observer.geometry import Float64Array
from observer.recording.payloads import Anchor, ParameterRevision, RobotRow, RunFacts
from observer.recording.writer import RecordingWriter
from observer.truth.motion_capture import BodySample
from observer.types import StereoFrame

from .engine_values import rectified_calibration

# Seconds to add to the times of motion capture.
OFFSET_S = 0.12
DURATION_S = 26.0
_RATE_HZ = 15.0
_INFO = {
    "spec": "camera:0,1", "kind": "camera", "width": 512, "height": 256, "frame_rate": _RATE_HZ,
    "frame_count": None, "live": True, "mount": None, "devices": [],
}  # fmt: skip


def run_folder(storage: Storage, run_id: str) -> Path:
    """Create and return the folder of a run's files."""
    folder = storage.folder.run(run_id)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def driven_m(t: Float64Array) -> Float64Array:
    """Return metres driven: waits, drives, waits, comes back, with rounded starts and stops."""
    fine = np.arange(-2, DURATION_S + 2, 1e-3)
    driven = 0.35 * (np.clip(fine - 3, 0, 5) - np.clip(fine - 12, 0, 6.3))
    kernel = np.ones(400) / 400
    rounded = np.convolve(np.pad(driven, 200, mode="edge"), kernel, "same")[200:-200]
    return np.asarray(np.interp(t, fine, rounded))


def speed(t: Float64Array) -> Float64Array:
    """Return the true speed, m/s."""
    return np.asarray(np.abs(driven_m(t + 0.005) - driven_m(t - 0.005)) / 0.01)


def plant_run(folder: Path, run_id: str = "20260101-120000-abcdef", *, heard: bool = False) -> Path:
    """Write a recording without images: one body drives to and fro before a still camera.

    Args:
        heard: also include live motion capture.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "recording.mcap"
    rng = np.random.default_rng(4)
    facts = RunFacts(
        id=run_id, name="planted", source="camera:0,1", info=_INFO, images="none",
        calibration_yaml=rectified_calibration(), versions={"dynamic-observer": "0.1.0"},
        anchor=Anchor(1_700_000_000_000_000_000, 100.0),
    )  # fmt: skip
    writer = RecordingWriter(path, facts)
    writer.parameters(ParameterRevision(revision=1, values={}), 100.0)
    image = np.zeros((256, 512), np.uint8)
    times = np.arange(0, DURATION_S, 1 / _RATE_HZ)
    driven, speeds = driven_m(times), speed(times)
    for number, time in enumerate(times.tolist()):
        received = 100.0 + time
        writer.frame(StereoFrame(number, time, image, image, received))
        line = _line(number, time, float(driven[number]), float(speeds[number]), rng)
        writer.observation(line, received)
        writer.robot(RobotRow(role="obstacle", received=received, time=time, sent_speed=0.35))
    if heard:
        writer.capture(_samples())
    writer.finish()
    return path


def truth_csv(path: Path) -> Path:
    """Write its motion capture as a plain CSV, on a clock of its own."""
    rows = [f"cart,{each.time:.4f}," + _cells(each.position) for each in _samples()]
    path.write_text("\n".join(["body,t,x,y,z", *rows]) + "\n")
    return path


def _samples() -> list[BodySample]:
    own = np.arange(-0.5, DURATION_S + 0.3, 0.01)
    places = np.column_stack([1 + driven_m(own + OFFSET_S), 2 + 0 * own, 0.1 + 0 * own])
    return [
        BodySample("cart", time, 100.0 + time, place, None)
        for time, place in zip(own.tolist(), places, strict=True)
    ]


def _cells(position: Float64Array | None) -> str:
    assert position is not None
    return ",".join(f"{value:.5f}" for value in position)


def _line(
    number: int, time: float, driven: float, true: float, rng: np.random.Generator
) -> dict[str, Any]:
    # Track 1 until 14 s, then track 2 of the same body; in between nothing is seen.
    track = 1 if time < 14 else 2
    seen = true + rng.normal(0, 0.005)
    x = driven + rng.normal(0, 0.002)
    obstacle = {
        "id": track, "state": "confirmed", "motion": "moving", "position": [x, 0.0, 3.0],
        "velocity": [seen, 0.0, 0.0], "speed": abs(seen), "speed_std": 0.01,
        "position_cov": None, "velocity_cov": None, "velocity_time": time,
        "size": [0.4, 0.3, 0.4], "orientation_wxyz": None, "range": 3.0, "bearing": 0.0,
        "closing_speed": 0.0, "points": 20, "significance": 9.0, "box_px": [200, 90, 260, 150],
        "why": "It moves.",
    }  # fmt: skip
    return {
        "frame": number, "time": time, "segment": 0, "status": "ok", "reasons": [],
        "parameters_revision": 1,
        "pose": {"position": [0.0, 0.0, 0.0], "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]},
        "obstacles": [] if 13.5 < time < 14.5 else [obstacle], "unseen": None, "timings_ms": {},
    }  # fmt: skip
