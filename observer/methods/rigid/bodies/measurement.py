"""Measurement of a body's position and yaw by all of its points at once."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array, Pose, cross_matrix, inverse_3x3
from observer.methods.rigid.bodies.filter import MEASURED, turning_velocity, yaw_matrix
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.vision.chi_square import quantile

# A point that fits its body worse than this leaves it; from half of this it counts for less.
_LEAVE_SIGMAS = 4.0
_FULL_WEIGHT_SIGMAS = 2.0
# Share of a sighting's variance that the same point's next sightings repeat: its surroundings stay
# the same, and so does the error of matching them.
_PERSISTENT = 0.5
_MEDIAN_CHI2 = quantile(0.5, df=3)
# Gauss-Newton converges quadratically; the yaw is never far from the prediction.
_STEPS = 3
# Metres and radians: a step smaller than this ends it.
_CONVERGED = 1e-4
# 1/rad^2: points all in one place say nothing of the yaw, and the equations must stay solvable.
_LEAST_YAW_INFORMATION = 1e-2
# By how much a body may have moved (variance, m^2: anywhere) and turned (rad) in a frame against
# expectation when it is judged which of its points fit.
_ANYWHERE = 1e6
_YAW_SLACK = 0.05


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
        own = points.shape_information.take(which, axis=0)
        known = np.trace(own, axis1=1, axis2=2) > 0
        cov = inverse_3x3(np.where(known[:, None, None], own, np.eye(3)))
        place = np.einsum("nij,nj->ni", cov, points.shape_vector.take(which, axis=0))
        noise = inverse_3x3(information.take(which, axis=0))
        cov = cov + _PERSISTENT * (R.T @ noise @ R)
        return Members(
            place=np.where(known[:, None], place, 0.0),
            place_cov=cov,
            known=known,
            sighting=sighting.take(which, axis=0),
            noise=noise,
        )

    def weighed(self, yaw: float) -> tuple[Float64Array, Float64Array]:
        """(N, 3, 3) covariance of the places, world axes, and information of the residuals.

        Of a body that has turned by about ``yaw`` radians: a few degrees more or less hardly turn
        the covariances, and they need not be made anew for each guess of the pose.
        """
        R = yaw_matrix(yaw)
        cov = R @ self.place_cov @ R.T
        return cov, inverse_3x3(self.noise + cov)

    def residuals(self, pose: Float64Array) -> tuple[Float64Array, Float64Array]:
        """(N, 3) metres by which they are elsewhere than a body at (4,) has them; its places."""
        spot = self.place @ yaw_matrix(float(pose[3])).T
        return self.sighting - pose[:3] - spot, spot


def measure_body(
    members: Members,
    expected: Float64Array,
    spread: Float64Array,
    T_camera_world: Pose,
    step_covariance: Float64Array,
    noise_correlation: float,
) -> BodyMeasurement:
    """The pose that brings the members nearest to where they are seen.

    Iterated and reweighted least squares (Huber weights, cut off where points count as strangers)
    about the pose that prediction and measurement agree on.

    Args:
        expected: (4,) predicted position, m, world, and yaw, rad; spread: (4, 4), its covariance.
        step_covariance: (6, 6) of the camera's motion over one frame (rad, m), camera axes; all
            members share this error.
        noise_correlation: share of the noise that the points of a body have in common.
    """
    cov, W = members.weighed(float(expected[3]))
    ego_noise = _ego_noise(expected[:3], T_camera_world, step_covariance)
    x = expected
    for _ in range(_STEPS):
        r, arm = members.residuals(x)
        Wr = np.einsum("nij,nj->ni", W, r)
        squared = np.einsum("ni,ni->n", r, Wr)
        # A place is noisy itself: on a flat face the noise along the line of sight would pass for
        # a lever and make the body seem to turn less than it does. Where it is to the best of both
        # knowledge, the noise of the lever has nothing to do with that of the residual.
        arm = arm + np.einsum("nij,nj->ni", cov, Wr)
        # Far from the answer all of them fit badly; only those that fit worse are strangers.
        length = np.sqrt(np.maximum(squared, 0.0)) / _scale(squared[members.known])
        weight = np.minimum(1.0, _FULL_WEIGHT_SIGMAS / np.maximum(length, 1e-9)) * members.known
        weight = weight * (length <= _LEAVE_SIGMAS)
        A, g = _normal_equations(W, Wr, turning_velocity(1.0, arm), weight)
        used = max(1.0, float(np.sum(weight > 0)))
        excess = max(1.0, float((weight * squared).sum()) / (3 * used))
        inverse = np.linalg.inv(A)
        M = inverse * (excess * (1 + noise_correlation * used))
        M[:3, :3] += ego_noise
        measured = x + inverse @ g
        before, x = x, expected + spread @ np.linalg.solve(spread + M, measured - expected)
        if np.abs(x - before).max() < _CONVERGED:
            break
    # Whether a point fits is judged by where the points are, not by where they should be.
    loose = spread.copy()
    loose[:3, :3] += np.eye(3) * _ANYWHERE
    loose[3, 3] += _YAW_SLACK**2
    best = expected + loose @ np.linalg.solve(loose + M, measured - expected)
    r, _ = members.residuals(best)
    squared = np.einsum("ni,nij,nj->n", r, W, r)
    limit = (_LEAVE_SIGMAS * _scale(squared[members.known])) ** 2
    return BodyMeasurement(measured, (M + M.T) / 2, members.known & (squared > limit))


def _normal_equations(
    W: Float64Array, Wr: Float64Array, swing: Float64Array, weight: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """(4, 4) and (4,) of least squares for position and yaw.

    Args:
        W: (N, 3, 3) information of the residuals, Wr: (N, 3) times the residuals. swing: (N, 3)
            metres by which a radian moves each point. weight: (N,).
    """
    A, g = np.empty((4, 4)), np.empty(4)
    W_swing = np.einsum("nij,nj->ni", W, swing)
    A[:3, :3] = (weight @ W.reshape(-1, 9)).reshape(3, 3)
    A[:3, 3] = A[3, :3] = weight @ W_swing
    A[3, 3] = weight @ np.einsum("ni,ni->n", swing, W_swing) + _LEAST_YAW_INFORMATION
    g[:3] = weight @ Wr
    g[3] = weight @ np.einsum("ni,ni->n", swing, Wr)
    return A, g


def expected_pose(
    mean: Float64Array, covariance: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Return the measured part of a filter's state: (4,) of (8,), (4, 4) of (8, 8)."""
    return mean[MEASURED], covariance[np.ix_(MEASURED, MEASURED)]


def _ego_noise(
    position: Float64Array, T_camera_world: Pose, step_covariance: Float64Array
) -> Float64Array:
    """(3, 3) m^2, world: how the camera's error moves what is at (3,) m, world."""
    p = T_camera_world.apply(position)
    G = T_camera_world.rotation.T @ np.concatenate([-cross_matrix(p), np.eye(3)], axis=1)
    return np.asarray(G @ step_covariance @ G.T)


def _scale(squared: Float64Array) -> float:
    """Scale by which Mahalanobis lengths exceed their noise, at least 1."""
    middle = len(squared) // 2
    return math.sqrt(max(1.0, float(np.partition(squared, middle)[middle]) / _MEDIAN_CHI2))
