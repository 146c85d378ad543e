"""The answer to an upload."""

from __future__ import annotations

import json

import numpy as np
import pytest

from observer.truth.files.description import describe_capture
from observer.truth.motion_capture import Capture, Trajectory

from .conftest import Read, nexus_csv


def test_describes_what_was_read(read: Read) -> None:
    # 0.5 m/s along x, 100 Hz, 2 s; unseen half of the time.
    run = np.zeros((201, 3))
    run[:, 0] = 5.0 * np.arange(201)
    lost = run + 100
    lost[::2] = np.nan
    described = describe_capture(read(nexus_csv({"robot": run + 1, "cart": lost})))
    assert described["format"] == "Vicon Nexus trajectories"
    assert described["rate_hz"] == 100
    assert described["duration_s"] == pytest.approx(2.0)
    robot, cart = described["bodies"]
    assert robot == {
        "name": "robot", "has_orientation": False, "samples": 201, "seen": 201, "gaps": 0,
        "from_s": 0.0, "to_s": 2.0, "extent_m": pytest.approx([1.0, 0, 0]),
        "highest_speed_mps": pytest.approx(0.5),
    }  # fmt: skip
    assert (cart["seen"], cart["gaps"], cart["highest_speed_mps"]) == (100, 101, None)
    assert "gaps: 101 of 402 samples are missing, in 1 of 2 bodies" in described["notes"]
    assert json.loads(json.dumps(described, allow_nan=False))["rate_hz"] == 100


def test_body_never_seen_has_no_extent() -> None:
    times = np.arange(20.0)
    body = Trajectory("ghost", times, np.full((20, 3), np.nan), np.full((20, 3, 3), np.nan))
    described = describe_capture(Capture("live", None, {"ghost": body}))
    (ghost,) = described["bodies"]
    assert ghost["has_orientation"]
    assert ghost["extent_m"] is None
    assert ghost["highest_speed_mps"] is None
    assert describe_capture(Capture("live", None, {}))["duration_s"] is None
