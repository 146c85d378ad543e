"""Trajectories for other tools, read back by our own reader of their format."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from observer.exporting.errors import ExportError
from observer.exporting.trajectories import write_tum
from observer.recording.reader import Recording
from observer.truth.files.recognition import read_capture


def written(recording: Recording, folder: Path, track: int | None = None) -> Path:
    path = folder / "trajectory.tum"
    with path.open("w") as file:
        write_tum(recording, file, track)
    return path


def test_the_cameras_trajectory_is_read_back(recorded: dict[str, Path], tmp_path: Path) -> None:
    with Recording(recorded["none"]) as recording:
        lines = [line for line in recording.lines() if line["pose"] is not None]
        (body,) = read_capture(written(recording, tmp_path)).bodies.values()
    assert body.times.tolist() == [line["time"] for line in lines]
    assert body.positions.tolist() == [line["pose"]["position"] for line in lines]
    assert body.rotations is not None
    w, x, y, z = lines[-1]["pose"]["orientation_wxyz"]
    forward = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]
    assert np.allclose(body.rotations[-1][:, 2], forward)


def test_an_obstacles_trajectory_is_read_back(recorded: dict[str, Path], tmp_path: Path) -> None:
    with Recording(recorded["none"]) as recording:
        seen = [
            (line["time"], each["position"])
            for line in recording.lines()
            for each in line["obstacles"]
            if each["id"] == 1
        ]
        (body,) = read_capture(written(recording, tmp_path, 1)).bodies.values()
        assert list(zip(body.times.tolist(), body.positions.tolist(), strict=True)) == seen
        with pytest.raises(ExportError, match="no obstacle 99"):
            written(recording, tmp_path, 99)
