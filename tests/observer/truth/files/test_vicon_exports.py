"""Real exports of one trial by Vicon Nexus, as CSV and as C3D."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from observer.errors import TruthError
from observer.truth.files.recognition import read_capture
from observer.truth.motion_capture import Capture
from observer.truth.speeds import smoothed_velocity

GAPS = 305
# The box lies on a table until the person picks it up.
STILL = slice(0, 80)


@pytest.fixture(scope="module")
def vicon(shared_data: Path) -> Path:
    folder = shared_data / "vicon"
    if not folder.is_dir():
        pytest.skip(f"recorded data is not here: {folder} is not a folder")
    return folder


@pytest.fixture(scope="module")
def trajectories(vicon: Path) -> Capture:
    return read_capture(vicon / "nexus_markers_pyomeca.csv")


def test_csv_is_read_with_all_its_gaps(trajectories: Capture) -> None:
    assert trajectories.format == "Vicon Nexus trajectories"
    assert trajectories.rate_hz == 100
    assert len(trajectories.bodies) == 51
    assert all(len(body.times) == 580 for body in trajectories.bodies.values())
    assert sum(body.gaps for body in trajectories.bodies.values()) == GAPS
    first = trajectories.bodies["boite:gauche_ext"].positions[0]
    np.testing.assert_allclose(first, [0.0441628, -0.276862, 0.675697], atol=1e-12)


def test_c3d_matches_csv_to_a_hundredth_of_a_millimetre(vicon: Path, trajectories: Capture) -> None:
    markers = read_capture(vicon / "nexus_markers_analogs_pyomeca.c3d")
    assert list(markers.bodies) == list(trajectories.bodies)
    worst_m = 0.0
    for name, body in markers.bodies.items():
        other = trajectories.bodies[name]
        np.testing.assert_array_equal(body.times, other.times)
        np.testing.assert_array_equal(body.seen, other.seen)
        worst_m = max(worst_m, float(np.nanmax(np.abs(body.positions - other.positions))))
    assert sum(body.gaps for body in markers.bodies.values()) == GAPS
    sys.stdout.write(f"\nCSV and C3D differ by at most {1000 * worst_m:.4f} mm\n")
    assert worst_m < 1e-5


def test_devices_alone_are_refused(vicon: Path) -> None:
    with pytest.raises(TruthError, match="it contains only Devices"):
        read_capture(vicon / "nexus_analogs_first400_pyomeca.csv")


def test_still_markers_have_almost_no_speed(trajectories: Capture) -> None:
    smoothed, raw = [], []
    for name, body in trajectories.bodies.items():
        if name.startswith("boite:"):
            velocity = smoothed_velocity(body.times[STILL], body.positions[STILL])
            smoothed.append(np.sqrt(np.nanmean((velocity**2).sum(axis=1))))
            steps = np.linalg.norm(np.diff(body.positions[STILL], axis=0), axis=1)
            speeds = steps / np.diff(body.times[STILL])
            raw.append(np.sqrt(np.nanmean(speeds**2)))
    sys.stdout.write(
        f"\nspeed of {len(smoothed)} still markers, mm/s: smoothed {1000 * min(smoothed):.2f} to "
        f"{1000 * max(smoothed):.2f}, raw {1000 * min(raw):.2f} to {1000 * max(raw):.2f}\n"
    )
    assert len(smoothed) == 8
    assert max(smoothed) < 0.9e-3
    assert all(s < r / 2 for s, r in zip(smoothed, raw, strict=True))
