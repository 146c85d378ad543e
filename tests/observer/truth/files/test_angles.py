"""Helical or Euler angles: what is detected, and what the user is asked."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from observer.geometry import Float64Array
from observer.truth.files.angles import AnglesUnclear, find_reading, rotations
from observer.truth.files.known import AngleReading

from .conftest import Read, places, tracker_csv

ANGLE = st.floats(-3.1, 3.1)


def driving(turn_rad: float, body: Rotation | None = None, *, seed: int = 0) -> Rotation:
    """Return a robot turning on a floor, tilting by 1 deg or so; ``body`` rotates its axes."""
    yaw = np.linspace(0, turn_rad, 500)[:, None]
    tilt = np.random.default_rng(seed).normal(0, 0.01, (500, 2))
    rotvec = np.column_stack([tilt, np.zeros(500)])
    turned = Rotation.from_euler("z", yaw) * Rotation.from_rotvec(rotvec)
    return turned if body is None else turned * body


def continuous(turned: Rotation) -> Float64Array:
    """Return rotation vectors as Tracker writes them: continuous past half, up to a full turn."""
    vectors = turned.as_rotvec()
    for k in range(1, len(vectors)):
        length = np.linalg.norm(vectors[k])
        other = vectors[k] * (1 - 2 * np.pi / length) if length > 0 else vectors[k]
        if np.linalg.norm(other - vectors[k - 1]) < np.linalg.norm(vectors[k] - vectors[k - 1]):
            vectors[k] = other
    return vectors


@given(ANGLE, ANGLE, ANGLE)
def test_rotations_match_the_meaning_of_the_angles(a: float, b: float, c: float) -> None:
    about = [
        Rotation.from_rotvec(angle * axis) for angle, axis in zip((a, b, c), np.eye(3), strict=True)
    ]
    angles = np.array([[a, b, c], [np.nan, b, c]])
    helical, euler = rotations(angles, "helical"), rotations(angles, "euler_xyz")
    np.testing.assert_allclose(helical[0], Rotation.from_rotvec([a, b, c]).as_matrix(), atol=1e-9)
    np.testing.assert_allclose(euler[0], (about[0] * about[1] * about[2]).as_matrix(), atol=1e-9)
    assert np.isnan(helical[1]).all()
    assert np.isnan(euler[1]).all()


def test_vectors_longer_than_half_a_turn_are_helical() -> None:
    angles = continuous(driving(6.2))
    assert np.linalg.norm(angles, axis=1).max() > 6
    found, why = find_reading("file", {"robot": angles})
    assert found == "helical"
    assert "rad, which Euler angles cannot" in why
    tilts = np.degrees(np.arccos(rotations(angles, found)[:, 2, 2]))
    assert tilts.max() < 4


@pytest.mark.parametrize("reading", ["helical", "euler_xyz"])
@pytest.mark.parametrize("seed", range(5))
def test_reading_is_found_from_the_tilt_of_a_body_with_its_own_axes(
    reading: AngleReading, seed: int
) -> None:
    body = Rotation.from_euler("XYZ", [0.5, -0.4, 0.3])
    turned = driving(2.5, body, seed=seed)
    angles = turned.as_rotvec() if reading == "helical" else turned.as_euler("XYZ")
    found, why = find_reading("file", {"still": np.full((500, 3), 0.1), "robot": angles})
    assert found == reading
    assert "read this way the bodies tilt by at most" in why


@pytest.mark.parametrize("reading", ["helical", "euler_xyz"])
def test_upright_robot_is_read_the_same_either_way(reading: AngleReading) -> None:
    # To and fro, across the point where Euler angles jump from half a turn to minus half.
    turned = driving(2.9)
    angles = turned.as_rotvec() if reading == "helical" else turned.as_euler("XYZ")
    found, _ = find_reading("file", {"robot": angles})
    error = Rotation.from_matrix(rotations(angles, found)) * turned.inv()
    assert np.degrees(error.magnitude()).max() < 5


def test_ambiguous_angles_need_a_choice_by_the_user(read: Read) -> None:
    wand = Rotation.random(200, rng=1).as_euler("XYZ")
    file = tracker_csv({"wand": (wand, places(200))})
    with pytest.raises(AnglesUnclear) as caught:
        read(file)
    assert "specify which was exported: helical or euler_xyz" in str(caught.value)
    assert caught.value.helical_tilt_deg > 90
    assert caught.value.euler_xyz_tilt_deg > 90
    for reading in ("helical", "euler_xyz"):
        capture = read(file, angles=reading)
        expected = rotations(wand, reading)
        np.testing.assert_allclose(capture.bodies["wand"].rotations, expected, atol=1e-4)
        assert f"angles are read as {reading.replace('_', ' ')}, as requested" in capture.notes


def test_body_driving_straight_needs_no_choice() -> None:
    angles = np.array([1.0, -0.5, 0.8]) + np.random.default_rng(0).normal(0, 1e-3, (500, 3))
    found, why = find_reading("file", {"robot": angles})
    assert found == "helical"
    assert "no body turns enough to distinguish them from Euler angles XYZ" in why


def test_unseen_bodies_are_read_as_helical() -> None:
    assert find_reading("file", {"robot": np.full((10, 3), np.nan)})[0] == "helical"
    assert find_reading("file", {})[0] == "helical"
