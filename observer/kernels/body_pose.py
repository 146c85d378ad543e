"""The pose of a rigid body from points whose places on it are known; see ``measure_body``."""

from __future__ import annotations

import math

import numpy as np

from observer.chi_square import quantile
from observer.kernels.compiled import (
    FLAGS1,
    REAL,
    REALS1,
    REALS2,
    REALS3,
    Flags,
    Reals,
    kernel,
    part,
)
from observer.kernels.small import gathered, inverse, inverse_symmetric, ranked

# Standard deviations: a point that fits its body worse than the first leaves it; beyond the second
# its weight falls.
_LEAVE_SIGMAS = 4.0
_FULL_WEIGHT_SIGMAS = 2.0
# Share of a sighting's variance that persists in the point's next sightings: its surroundings stay
# the same, and so does the matching error.
_PERSISTENT = 0.5
_MEDIAN_CHI2 = quantile(0.5, df=3)
# Gauss-Newton converges quadratically; the yaw is never far from the prediction.
_STEPS = 3
# Metres and radians: iteration ends when a step is smaller than this.
_CONVERGED = 1e-4
# 1/rad^2: points all in one place say nothing of the yaw, and the equations must stay solvable.
_LEAST_YAW_INFORMATION = 1e-2
# Slack on the prediction when testing which points fit: variance of the position, m^2 (anywhere),
# and standard deviation of the yaw, rad.
_ANYWHERE = 1e6
_YAW_SLACK = 0.05


@kernel(REALS3, REALS2, REALS3, REALS2)
def place_members(
    shape_information: Reals, shape_vector: Reals, information: Reals, R: Reals
) -> tuple[Reals, Reals, Flags, Reals]:
    """Return where N points are on their body, with covariances of that and of their sightings.

    Args:
        shape_information: (N, 3, 3) and shape_vector: (N, 3), as of ``TrackedPoints``.
            information: (N, 3, 3) of the sightings, 1/m^2, world. R: (3, 3) from the body's frame
            to the world's.

    Returns:
        Places (N, 3) m, body's frame, 0 if unknown; their covariances (N, 3, 3), including the
        persistent errors of sightings; which are known (N,); the sightings' covariances (N, 3, 3).
    """
    count = len(shape_vector)
    place, cov, known, noise = (
        np.empty((count, 3)), np.empty((count, 3, 3)), np.empty(count, np.bool_),
        np.empty((count, 3, 3)),
    )  # fmt: skip
    turned = np.empty((3, 3))
    for i in range(count):
        A = shape_information[i]
        known[i] = A[0, 0] + A[1, 1] + A[2, 2] > 0.0
        if known[i]:
            inverse_symmetric(A, cov[i])
        for j in range(3):
            for k in range(3):
                if not known[i]:
                    cov[i, j, k] = 1.0 if j == k else 0.0
            place[i, j] = 0.0
            for k in range(3):
                if known[i]:
                    place[i, j] += cov[i, j, k] * shape_vector[i, k]
        inverse_symmetric(information[i], noise[i])
        for j in range(3):
            for k in range(3):
                turned[j, k] = 0.0
                for m in range(3):
                    turned[j, k] += R[m, j] * noise[i, m, k]
        for j in range(3):
            for k in range(3):
                for m in range(3):
                    cov[i, j, k] += _PERSISTENT * turned[j, m] * R[m, k]
    return place, cov, known, noise


@part
def _weigh(place_cov: Reals, noise: Reals, yaw: float, cov: Reals, W: Reals) -> None:
    """Write covariances (N, 3, 3) of the places, world axes, and information of the residuals.

    They are rotated by the predicted ``yaw``, radians: a few degrees hardly change them, so they
    need not be recomputed at each step of the fit.
    """
    c, s = math.cos(yaw), math.sin(yaw)
    C, total = np.empty((3, 3)), np.empty((3, 3))
    for i in range(len(place_cov)):
        # R C R^T, first the rows, then the columns.
        for k in range(3):
            C[0, k] = c * place_cov[i, 0, k] + s * place_cov[i, 2, k]
            C[1, k] = place_cov[i, 1, k]
            C[2, k] = c * place_cov[i, 2, k] - s * place_cov[i, 0, k]
        for k in range(3):
            cov[i, k, 0] = c * C[k, 0] + s * C[k, 2]
            cov[i, k, 1] = C[k, 1]
            cov[i, k, 2] = c * C[k, 2] - s * C[k, 0]
        for j in range(3):
            for k in range(3):
                total[j, k] = noise[i, j, k] + cov[i, j, k]
        inverse_symmetric(total, W[i])


@part
def _residuals(
    place: Reals, sighting: Reals, W: Reals, x: Reals, r: Reals, Wr: Reals, squared: Reals
) -> None:
    """Write the residuals of points (N, 3) m relative to a body at x (4,).

    Args:
        r: (N, 3) metres, Wr: (N, 3) times their information, squared: (N,), r W r.
    """
    c, s = math.cos(x[3]), math.sin(x[3])
    for i in range(len(place)):
        r[i, 0] = sighting[i, 0] - x[0] - (c * place[i, 0] + s * place[i, 2])
        r[i, 1] = sighting[i, 1] - x[1] - place[i, 1]
        r[i, 2] = sighting[i, 2] - x[2] - (c * place[i, 2] - s * place[i, 0])
        squared[i] = 0.0
        for j in range(3):
            Wr[i, j] = W[i, j, 0] * r[i, 0] + W[i, j, 1] * r[i, 1] + W[i, j, 2] * r[i, 2]
            squared[i] += r[i, j] * Wr[i, j]


@part
def _scale(squared: Reals, known: Flags, scratch: Reals) -> float:
    """Return the factor by which the residuals of known points exceed their noise, at least 1."""
    count = gathered(squared, known, scratch)
    middle = ranked(scratch[:count], count // 2)
    return math.sqrt(max(1.0, middle / _MEDIAN_CHI2))


@part
def _agreed(expected: Reals, spread: Reals, measured: Reals, M: Reals, x: Reals) -> None:
    """Fuse a prediction with covariance spread and a measurement with covariance M into x (4,)."""
    S, inverted = np.empty((4, 4)), np.empty((4, 4))
    for k in range(4):
        for m in range(4):
            S[k, m] = spread[k, m] + M[k, m]
    inverse(S, inverted)
    for k in range(4):
        x[k] = expected[k]
        for m in range(4):
            weight = 0.0
            for n in range(4):
                weight += spread[k, n] * inverted[n, m]
            x[k] += weight * (measured[m] - expected[m])


@kernel(REALS2, REALS3, FLAGS1, REALS2, REALS3, REALS1, REALS2, REALS2, REAL)
def fit_body(
    place: Reals, place_cov: Reals, known: Flags, sighting: Reals, noise: Reals,
    expected: Reals, spread: Reals, ego_noise: Reals, noise_correlation: float,
) -> tuple[Reals, Reals, Flags]:  # fmt: skip
    """Return pose (4,) and covariance (4, 4) of a body from N points, and which do not fit (N,).

    Args:
        place ... noise: as of ``Members``; at least one is known. expected: (4,) position, m,
            world, and yaw, rad, with covariance spread (4, 4). ego_noise: (3, 3) m^2, common to
            all points. noise_correlation: share of the noise that they have in common.
    """
    count = len(place)
    cov, W = np.empty((count, 3, 3)), np.empty((count, 3, 3))
    r, Wr, squared, scratch = (
        np.empty((count, 3)), np.empty((count, 3)), np.empty(count), np.empty(count),
    )  # fmt: skip
    A, M, g, swing, Ws = (
        np.empty((4, 4)), np.empty((4, 4)), np.empty(4), np.empty(3), np.empty(3),
    )  # fmt: skip
    x, before, measured, scale = expected.copy(), np.empty(4), np.empty(4), 1.0
    tight, loose, misfits = spread.copy(), spread.copy(), np.empty(count, np.bool_)
    for k in range(3):
        loose[k, k] += _ANYWHERE
    loose[3, 3] += _YAW_SLACK**2
    _weigh(place_cov, noise, expected[3], cov, W)
    last = False
    for turn in range(_STEPS + 1):
        _residuals(place, sighting, W, x, r, Wr, squared)
        scale = _scale(squared, known, scratch)
        if last:
            break
        used, total = 0, 0.0
        for k in range(4):
            g[k] = 0.0
            for m in range(4):
                A[k, m] = 0.0
        for i in range(count):
            # Far from the solution all points fit badly; only those that fit worse are outliers.
            length = math.sqrt(max(squared[i], 0.0)) / scale
            if not known[i] or not length <= _LEAVE_SIGMAS:
                continue
            weight = min(1.0, _FULL_WEIGHT_SIGMAS / max(length, 1e-9))
            used += 1
            total += weight * squared[i]
            # The place on the body is noisy itself: on a flat face its noise along the line of
            # sight would act as a lever arm and bias the turn towards zero. With the place fused
            # from model and sighting, the lever's noise is uncorrelated with the residual's.
            right, ahead = sighting[i, 0] - x[0] - r[i, 0], sighting[i, 2] - x[2] - r[i, 2]
            for k in range(3):
                right += cov[i, 0, k] * Wr[i, k]
                ahead += cov[i, 2, k] * Wr[i, k]
            swing[0], swing[1], swing[2] = ahead, 0.0, -right
            for k in range(3):
                Ws[k] = W[i, k, 0] * swing[0] + W[i, k, 2] * swing[2]
                g[k] += weight * Wr[i, k]
                for m in range(3):
                    A[k, m] += weight * W[i, k, m]
                A[k, 3] += weight * Ws[k]
            A[3, 3] += weight * (swing[0] * Ws[0] + swing[2] * Ws[2])
            g[3] += weight * (swing[0] * Wr[i, 0] + swing[2] * Wr[i, 2])
        A[3, 3] += _LEAST_YAW_INFORMATION
        for k in range(3):
            A[3, k] = A[k, 3]
        inverse(A, M)
        number = float(max(used, 1))
        excess = max(1.0, total / (3.0 * number)) * (1.0 + noise_correlation * number)
        change = 0.0
        for k in range(4):
            before[k] = x[k]
            measured[k] = x[k]
            for m in range(4):
                measured[k] += M[k, m] * g[m]
        for k in range(4):
            for m in range(4):
                M[k, m] *= excess
                if k < 3 and m < 3:
                    M[k, m] += ego_noise[k, m]
        _agreed(expected, tight, measured, M, x)
        for k in range(4):
            change = max(change, abs(x[k] - before[k]))
        last = turn == _STEPS - 1 or change < _CONVERGED
        if last:
            # Test the fit at the pose measured from the points, not at the predicted one.
            _agreed(expected, loose, measured, M, x)
    limit = (_LEAVE_SIGMAS * scale) ** 2
    for i in range(count):
        misfits[i] = known[i] and squared[i] > limit
    return measured, M, misfits
