"""Measurement of a body's position and yaw by all of its points at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array, Pose, cross_matrix
from observer.kernels.body_pose import fit_body, place_members
from observer.methods.rigid.bodies.filter import MEASURED
from observer.methods.rigid.tracked_points import TrackedPoints


@dataclass(frozen=True, eq=False)
class BodyMeasurement:
    """Measured pose of a body.

    Attributes:
        pose: (4,) metres, world, and yaw in radians. covariance: (4, 4).
        misfits: (N,) which of its points do not move with it.
    """

    pose: Float64Array
    covariance: Float64Array
    misfits: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Members:
    """Points of one body, where they are on it and where they are seen.

    Attributes:
        place: (N, 3) metres, the body's frame. place_cov: (N, 3, 3).
        known: (N,) whether that is known.
        sighting: (N, 3) metres, world. noise: (N, 3, 3) of the sighting.
    """

    place: Float64Array
    place_cov: Float64Array
    known: NDArray[np.bool_]
    sighting: Float64Array
    noise: Float64Array

    @staticmethod
    def of(
        points: TrackedPoints,
        which: NDArray[np.intp],
        sighting: Float64Array,
        information: Float64Array,
        R: Float64Array,
    ) -> Members:
        """Select the tracked points of a body.

        Args:
            sighting: (P, 3) metres, world, and information: (P, 3, 3), of all followed points.
            R: (3, 3) from the body's frame to the world's.
        """
        place, place_cov, known, noise = place_members(
            points.shape_information.take(which, axis=0),
            points.shape_vector.take(which, axis=0),
            information.take(which, axis=0),
            R,
        )
        return Members(place, place_cov, known, sighting.take(which, axis=0), noise)


def measure_body(
    members: Members,
    expected: Float64Array,
    spread: Float64Array,
    T_camera_world: Pose,
    step_covariance: Float64Array,
    noise_correlation: float,
) -> BodyMeasurement:
    """Return the pose that brings the members nearest to where they are seen.

    Iteratively reweighted least squares (Huber weights, 0 where points count as strangers) about
    the pose that prediction and measurement agree on.

    Args:
        expected: (4,) predicted position, m, world, and yaw, rad; spread: (4, 4), its covariance.
        step_covariance: (6, 6) of the camera's motion over one frame (rad, m), camera axes; all
            members share this error.
        noise_correlation: share of the noise that the points of a body have in common.
    """
    ego_noise = _ego_noise(expected[:3], T_camera_world, step_covariance)
    return BodyMeasurement(
        *fit_body(
            members.place, np.ascontiguousarray(members.place_cov), members.known,
            members.sighting, members.noise,
            expected, spread, ego_noise, noise_correlation,
        )
    )  # fmt: skip


def expected_pose(
    mean: Float64Array, covariance: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Return the measured part of a filter's state: (4,) of (8,), (4, 4) of (8, 8)."""
    return mean[MEASURED], covariance[np.ix_(MEASURED, MEASURED)]


def _ego_noise(
    position: Float64Array, T_camera_world: Pose, step_covariance: Float64Array
) -> Float64Array:
    """(3, 3) m^2, world: covariance, by the camera's motion error, of a position (3,) m, world."""
    p = T_camera_world.apply(position)
    G = T_camera_world.rotation.T @ np.concatenate([-cross_matrix(p), np.eye(3)], axis=1)
    return np.asarray(G @ step_covariance @ G.T)
