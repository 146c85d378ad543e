"""A rigid motion is found despite outliers, and refused where the points do not determine it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.errors import NotObservable
from observer.geometry import Pose
from observer.truth.alignment.frame_alignment import align_planar, upright

UP = np.array([0.0, 0.0, 1.0])


@settings(max_examples=40)
@given(st.floats(-3.1, 3.1), st.integers(0, 10**6))
def test_yaw_and_translation_are_found_despite_outliers(yaw: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    room = np.column_stack([rng.uniform(-2, 2, (120, 2)), np.full(120, 0.2)])
    down = np.array([0.05, 1.0, 0.15])
    T = (
        Pose(upright(-down).T, np.zeros(3))
        @ Pose.from_rotvec([0, 0, yaw], [*rng.uniform(-5, 5, 2), 0.4])
    )  # fmt: skip
    seen = T.apply(room) + rng.normal(0, 0.02, room.shape)
    seen[:30] += rng.uniform(-3, 3, (30, 3))
    found, residual_m = align_planar(room, seen, UP, -down)
    apart = found.inverse() @ T
    assert np.degrees(np.linalg.norm(apart.rotvec)) < 1.0
    assert np.linalg.norm(apart.translation) < 0.03
    assert residual_m < 0.1


def test_straight_drive_determines_the_yaw() -> None:
    source = np.column_stack([np.linspace(0, 2, 50), np.zeros((50, 2))])
    yaw = Pose.from_rotvec([0, 0, 1.0], [1, 2, 0.5])
    found, _ = align_planar(source, yaw.apply(source), UP, UP)
    np.testing.assert_allclose(found.matrix, yaw.matrix, atol=1e-9)


def test_stationary_body_does_not_determine_the_yaw() -> None:
    source = np.random.default_rng(0).normal(0, 0.05, (50, 3))
    with pytest.raises(NotObservable, match="drive further"):
        align_planar(source, source, UP, UP)


def test_two_points_are_too_few() -> None:
    with pytest.raises(NotObservable, match="only 2 positions"):
        align_planar(np.zeros((2, 3)), np.zeros((2, 3)), UP, UP)
