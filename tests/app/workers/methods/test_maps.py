"""Recorded local maps in the scene from above: where they lie, and in which frames they apply."""

from __future__ import annotations

import math
from dataclasses import asdict

import msgspec
import numpy as np
import pytest

from app.contract.run_frames import RunFrames
from app.contract.values import json_text, plain
from app.server.runs.frame_window import some_frames
from app.workers.methods.frames import run_frames
from observer.calibration.formats.opencv_file import calibration_text
from observer.mount import CameraMount
from observer.occupancy import BLOCKED, FREE, OccupancyMap
from observer.opening import open_source
from observer.recording.payloads import LocalMapPayload, RunFacts
from observer.recording.reader import Recording
from observer.recording.writer import RecordingWriter
from observer.types import StereoFrame

_FRAMES = 9
_YAW = 0.4
_MOUNT = CameraMount(0.5, 0.2, 0.1, 0.05)
_CELLS = np.array([[FREE, FREE], [BLOCKED, 0]], np.uint8)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> RunFrames:
    """Frames of a camera at rest, two of them with a map."""
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    source = open_source("simulated:drive").source
    assert source.calibration is not None
    writer = RecordingWriter(
        path,
        RunFacts(
            id="run",
            name="a run",
            source=source.info.spec,
            info={},
            calibration_yaml=calibration_text(source.calibration),
            images="none",
            mount=asdict(_MOUNT),
        ),
    )
    image = np.zeros((source.info.height, source.info.width), np.uint8)
    source.close()
    for k in range(_FRAMES):
        received = 100.0 + k / 10
        writer.frame(StereoFrame(k, k / 10, image, image, received))
        line = {
            "frame": k, "time": k / 10, "segment": 0, "status": "ok", "reasons": [],
            "parameters_revision": 1, "obstacles": [], "unseen": None, "timings_ms": {},
            "pose": {"position": [0.0] * 3, "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]},
        }  # fmt: skip
        writer.observation(line, received)
        if k in (2, 6):
            # Half a metre ahead of the robot, and a little to its right.
            x, y = 3.0 + 0.5 * math.cos(_YAW), 1.0 + 0.5 * math.sin(_YAW)
            local = OccupancyMap.of(_CELLS, (x, y), 0.1, (3.0, 1.0, _YAW), received)
            writer.local_map(LocalMapPayload(frame=k, time=k / 10, map=local))
    writer.finish()
    with Recording(path) as recording:
        return run_frames(recording, None)


def test_a_map_is_placed_ahead_of_the_robot(found: RunFrames) -> None:
    first, second = found.maps
    assert (first.first, first.last) == (2, 5)
    assert (second.first, second.last) == (6, _FRAMES - 1)
    # From the camera's place, which is ahead of the robot and to its left.
    assert first.corner == pytest.approx([0.5 - 0.1, -0.05, -_YAW], abs=2e-3)
    assert (first.cell_m, first.size, list(first.runs)) == (0.1, 2, [0, 2, 1, 1])


@pytest.mark.parametrize(
    ("window", "first_of_maps"),
    [
        ((0, None, None), [2, 6]),
        ((0, 2, None), []),
        ((4, 2, None), [2]),
        ((5, 2, None), [2, 6]),
        # Where some frames are left out, the others come later, with their maps.
        ((0, None, 3), []),
    ],
)
def test_a_window_has_the_maps_in_effect_in_it(
    found: RunFrames, window: tuple[int, int | None, int | None], first_of_maps: list[int]
) -> None:
    content = json_text(plain(found))
    told = msgspec.json.decode(some_frames(content.encode(), *window))
    assert [one["first"] for one in told["maps"]] == first_of_maps
