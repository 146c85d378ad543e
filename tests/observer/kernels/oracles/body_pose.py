"""Oracle of ``observer.kernels.body_pose``: the same formulas by numpy."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from observer.chi_square import quantile
from observer.geometry import Float64Array
from observer.methods.rigid.bodies.filter import turning_velocity, yaw_matrix
from observer.methods.rigid.bodies.measurement import Members

# A point that fits its body worse than this leaves it; from half of this on it counts less.
_LEAVE_SIGMAS = 4.0
_FULL_WEIGHT_SIGMAS = 2.0
# Share of a sighting's variance that recurs in the point's next sightings: its surroundings stay
# the same, and so does the error of matching them.
_PERSISTENT = 0.5
_MEDIAN_CHI2 = quantile(0.5, df=3)
# Gauss-Newton converges quadratically; the yaw is never far from the prediction.
_STEPS = 3
# Metres and radians: a smaller step ends the iteration.
_CONVERGED = 1e-4
# 1/rad^2: keeps the equations solvable for points all in one place, which do not show the yaw.
_LEAST_YAW_INFORMATION = 1e-2
# How far a body may have moved (variance, m^2: anywhere) and turned (rad) in a frame beyond
# what is expected, when judging which of its points fit.
_ANYWHERE = 1e6
_YAW_SLACK = 0.05


def inverted(matrices: Float64Array) -> Float64Array:
    """(N, 3, 3) inverses."""
    return np.asarray(np.linalg.inv(matrices), np.float64)


def place_members(
    shape_information: Float64Array,
    shape_vector: Float64Array,
    information: Float64Array,
    R: Float64Array,
) -> tuple[Float64Array, Float64Array, NDArray[np.bool_], Float64Array]:
    """Where points are on their body, and with what covariance, see the kernel."""
    known: NDArray[np.bool_] = np.trace(shape_information, axis1=1, axis2=2) > 0
    cov = inverted(np.where(known[:, None, None], shape_information, np.eye(3)))
    place = np.einsum("nij,nj->ni", cov, shape_vector) * known[:, None]
    noise = inverted(information)
    return place, cov + _PERSISTENT * (R.T @ noise @ R), known, noise


def weighed(members: Members, yaw: float) -> tuple[Float64Array, Float64Array]:
    """(N, 3, 3) covariance of the places, world axes, and information of the residuals."""
    R = yaw_matrix(yaw)
    cov = R @ members.place_cov @ R.T
    return cov, inverted(members.noise + cov)


def residuals(members: Members, pose: Float64Array) -> tuple[Float64Array, Float64Array]:
    """(N, 3) metres from where a body at (4,) has the points to where they are; its places."""
    spot = members.place @ yaw_matrix(float(pose[3])).T
    return members.sighting - pose[:3] - spot, spot


def fit_body(
    members: Members,
    expected: Float64Array,
    spread: Float64Array,
    ego_noise: Float64Array,
    noise_correlation: float,
) -> tuple[Float64Array, Float64Array, NDArray[np.bool_]]:
    """Pose (4,) and covariance (4, 4) of a body, and which points do not fit, see the kernel."""
    cov, W = weighed(members, float(expected[3]))
    x = expected
    for _ in range(_STEPS):
        r, arm = residuals(members, x)
        Wr = np.einsum("nij,nj->ni", W, r)
        squared = np.einsum("ni,ni->n", r, Wr)
        # A place is noisy too: on a flat face, noise along the line of sight would act as a lever
        # arm and make the body seem to turn less than it does. With the place estimated from both,
        # the noise of the lever is independent of that of the residual.
        arm = arm + np.einsum("nij,nj->ni", cov, Wr)
        # Far from the solution all points fit badly; only those that fit worse are outliers.
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
    r, _ = residuals(members, best)
    squared = np.einsum("ni,nij,nj->n", r, W, r)
    limit = (_LEAVE_SIGMAS * _scale(squared[members.known])) ** 2
    return measured, (M + M.T) / 2, members.known & (squared > limit)


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


def _scale(squared: Float64Array) -> float:
    """Scale by which Mahalanobis lengths exceed their noise, at least 1."""
    middle = len(squared) // 2
    return math.sqrt(max(1.0, float(np.partition(squared, middle)[middle]) / _MEDIAN_CHI2))
