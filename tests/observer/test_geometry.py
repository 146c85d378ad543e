"""Poses and planar maps: the rules that every frame of reference relies on."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from observer.geometry import Pose, is_rotation, largest_sigma, map_pixels

small = st.floats(-3, 3, allow_nan=False)
vectors = st.tuples(small, small, small)
poses = st.builds(Pose.from_rotvec, vectors, vectors)
quick = settings(max_examples=40)


@quick
@given(poses, vectors)
def test_the_inverse_undoes_a_pose(T_a_b: Pose, point: tuple[float, float, float]) -> None:
    np.testing.assert_allclose(T_a_b.inverse().apply(T_a_b.apply(point)), point, atol=1e-9)
    np.testing.assert_allclose((T_a_b @ T_a_b.inverse()).matrix, np.eye(4), atol=1e-9)


@quick
@given(poses, poses, vectors)
def test_a_product_applies_the_right_factor_first(
    T_a_b: Pose, T_b_c: Pose, point: tuple[float, float, float]
) -> None:
    np.testing.assert_allclose(
        (T_a_b @ T_b_c).apply(point), T_a_b.apply(T_b_c.apply(point)), atol=1e-9
    )


@quick
@given(poses)
def test_every_representation_round_trips(pose: Pose) -> None:
    for again in (
        Pose.from_matrix(pose.matrix),
        Pose.from_matrix(pose.matrix[:3]),
        Pose.from_rotvec(pose.rotvec, pose.translation),
        Pose.from_quaternion(pose.quaternion_wxyz, pose.translation),
        Pose.from_quaternion(-2 * pose.quaternion_wxyz, pose.translation),
    ):
        np.testing.assert_allclose(again.matrix, pose.matrix, atol=1e-7)
    assert pose.quaternion_wxyz[0] >= 0
    assert np.linalg.norm(pose.quaternion_wxyz) == pytest.approx(1)


def test_rotate_ignores_the_translation() -> None:
    pose = Pose.from_rotvec((0, np.pi / 2, 0), (5, 6, 7))
    np.testing.assert_allclose(pose.rotate((0, 0, 1)), (1, 0, 0), atol=1e-12)
    np.testing.assert_allclose(pose.apply((0, 0, 1)), (6, 6, 7), atol=1e-12)
    assert pose.apply(np.zeros((4, 2, 3))).shape == (4, 2, 3)


def test_a_long_chain_of_products_stays_a_rotation() -> None:
    step, pose = Pose.from_rotvec((0.01, 0.02, -0.015), (0.01, 0, 0)), Pose.identity()
    for _ in range(5000):
        pose = pose @ step
    assert is_rotation(pose.rotation, 1e-12)


@pytest.mark.parametrize(
    ("rotation", "translation", "sentence"),
    [
        (np.diag([1.0, 1.0, -1.0]), np.zeros(3), "must be a rotation"),
        (2 * np.eye(3), np.zeros(3), "must be a rotation"),
        (np.eye(3), np.array([0, np.nan, 0]), "must be finite"),
        (np.eye(4), np.zeros(3), r"\(3, 3\)"),
        (np.eye(3), np.zeros(2), r"\(3,\)"),
    ],
)
def test_an_invalid_pose_is_refused(
    rotation: np.ndarray, translation: np.ndarray, sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        Pose(rotation, translation)


def test_a_pose_copies_its_input_and_is_read_only() -> None:
    rotation, translation = np.eye(3), np.zeros(3)
    pose = Pose(rotation, translation)
    translation[0] = rotation[0, 0] = 9
    np.testing.assert_array_equal(pose.matrix, np.eye(4))
    with pytest.raises(ValueError, match="read-only"):
        pose.translation[0] = 1


@pytest.mark.parametrize("matrix", [np.eye(2), np.eye(3) * np.nan, np.zeros((3, 3))])
def test_an_invalid_rotation_is_detected(matrix: np.ndarray) -> None:
    assert not is_rotation(matrix)
    assert is_rotation(Rotation.from_rotvec([0.3, -2, 1]).as_matrix())


def test_map_pixels_applies_affine_and_perspective_maps() -> None:
    px = np.array([[10.0, 20.0], [0.0, 0.0]])
    affine = np.array([[1, 0.5, 3], [0, 2, -1], [0, 0, 1]])
    np.testing.assert_allclose(map_pixels(affine, px), [[23, 39], [3, -1]])
    perspective = np.array([[1, 0, 0], [0, 1, 0], [0.1, 0, 1]])
    np.testing.assert_allclose(map_pixels(perspective, px), [[5, 10], [0, 0]])
    np.testing.assert_allclose(map_pixels(np.linalg.inv(affine), map_pixels(affine, px)), px)
    assert map_pixels(affine, np.empty((0, 2))).shape == (0, 2)


@quick
@given(poses, st.tuples(st.floats(0, 3), st.floats(0, 3), st.floats(0, 3)))
def test_the_largest_sigma_is_that_of_the_longest_axis(
    pose: Pose, sigmas: tuple[float, float, float]
) -> None:
    axes = pose.rotation.T
    covariance = axes.T @ np.diag(np.square(sigmas)) @ axes
    assert largest_sigma(covariance) == pytest.approx(max(sigmas), abs=1e-7)
