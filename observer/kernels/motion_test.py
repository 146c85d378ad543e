"""Motion of points, each alone, and pooled over neighbours that move alike."""

from __future__ import annotations

import math

import numpy as np

from observer.kernels.compiled import (
    CAMERA,
    FLAGS1,
    REAL,
    REALS1,
    REALS2,
    REALS3,
    SINGLES2,
    WHOLE,
    WHOLES1,
    WHOLES2,
    Camera,
    Flags,
    Indices,
    Reals,
    Singles,
    kernel,
    part,
)
from observer.kernels.lasting_errors import lasting_error
from observer.kernels.small import determinant, inverse_symmetric, product, squared_length

# Neighbours must agree in depth to within this many standard deviations.
_DEPTH_SIGMAS = 3.0
# Factor on the variance of the slope when a regression runs over a random walk of the pose.
RANDOM_WALK = 1.2
# Above rounding errors: product of the three eigenvalues of an information, relative to the cube of
# their mean; and their mean, relative to the sums whose difference it is.
_LEAST_RANK = 1e-12
_LEAST_REMAINDER = 1e-9
# Information below this counts as none.
_TINY = 1e-12


@part
def _trace(A: Reals) -> float:
    return float(A[0, 0] + A[1, 1] + A[2, 2])


@kernel(
    WHOLES1, FLAGS1, REALS2, REALS3, REALS3, REALS3, REALS3, REALS2, REALS2, REALS1, REALS1, WHOLE
)  # fmt: skip
def own_motion(
    sightings: Indices, telling: Flags, origin: Reals, a0: Reals, place_cov: Reals, a1: Reals,
    a2: Reals, b0: Reals, b1: Reals, c0: Reals, count: Reals, min_sightings: int,
) -> tuple[Flags, Reals, Reals, Reals, Reals, Reals, Reals, Reals, Reals]:  # fmt: skip
    """Fit the motion of N points, each alone, from its sums of ``PositionVelocityFilter``.

    Args:
        sightings: (N,). telling: (N,), as of ``TrackedPoints``.
        origin ... count: the sums. place_cov: (N, 3, 3) m^2, the inverse of a0.

    Returns:
        ready (N,), velocity (N, 3) m/s with covariance (N, 3, 3), information (N, 3, 3) and vector
        (N, 3), position (N, 3) m with covariance (N, 3, 3), window (N,) s over which it was
        sighted, and excess (N,), 1 or more: reduced chi-squared of the sightings about a straight
        course, the sum of squared Mahalanobis residuals over the degrees of freedom. All
        covariances are inflated by it: a point that brakes or turns does not fit a straight course,
        so its velocity is less certain than the noise alone suggests.
    """
    n = len(sightings)
    ready, window, excess = np.empty(n, np.bool_), np.empty(n), np.empty(n)
    velocity, vector, position = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    cov, information = np.empty((n, 3, 3)), np.empty((n, 3, 3))
    position_cov = np.empty((n, 3, 3))
    gain, inner, lever, half = (
        np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)),
    )  # fmt: skip
    for i in range(n):
        # Information and vector of the velocity: A2 - A1 A0^-1 A1, and b1 - A1 A0^-1 b0.
        product(a1[i], place_cov[i], gain)
        product(gain, a1[i], inner)
        known = True
        for r in range(3):
            vector[i, r] = b1[i, r]
            for c in range(3):
                information[i, r, c] = a2[i, r, c] - (inner[r, c] + inner[c, r]) / 2
                vector[i, r] -= gain[r, c] * b0[i, c]
            known = known and math.isfinite(vector[i, r])
        # If a point is seen along one line only, or always at one instant, its velocity is unknown.
        scale = _trace(information[i]) / 3
        ready[i] = (
            known
            and telling[i]
            and sightings[i] >= min_sightings
            and scale > _LEAST_REMAINDER * _trace(a2[i])
            and determinant(information[i]) > _LEAST_RANK * scale**3
        )
        if ready[i]:
            inverse_symmetric(information[i], cov[i])
        for r in range(3):
            velocity[i, r] = 0.0
            for c in range(3):
                if not ready[i]:
                    cov[i, r, c] = 1.0 if r == c else 0.0
                    information[i, r, c] = 0.0
                else:
                    velocity[i, r] += cov[i, r, c] * vector[i, c]
            if not ready[i]:
                vector[i, r] = 0.0
        # Its position now if it moves at this velocity: origin + A0^-1 (b0 - A1 v).
        explained = 0.0
        for r in range(3):
            position[i, r] = origin[i, r]
            for c in range(3):
                rest = b0[i, c]
                for k in range(3):
                    rest -= a1[i, c, k] * velocity[i, k]
                position[i, r] += place_cov[i, r, c] * rest
            explained += (position[i, r] - origin[i, r]) * b0[i, r] + velocity[i, r] * b1[i, r]
        excess[i] = (c0[i] - explained) / max(3 * count[i] - 6, 1.0)
        if excess[i] < 1.0:
            excess[i] = 1.0
        product(place_cov[i], a1[i], lever)
        product(lever, cov[i], half)
        for r in range(3):
            for c in range(3):
                total = place_cov[i, r, c]
                if ready[i]:
                    for k in range(3):
                        total += half[r, k] * lever[c, k]
                position_cov[i, r, c] = total * excess[i]
        for r in range(3):
            vector[i, r] /= excess[i]
            for c in range(3):
                cov[i, r, c] *= excess[i]
                information[i, r, c] /= excess[i]
        # Length of a uniform window with the same variance of the sighting times.
        weight = max(_trace(a0[i]), _TINY)
        mean = -_trace(a1[i]) / weight
        window[i] = math.sqrt(12 * max(_trace(a2[i]) / weight - mean * mean, 0.0))
    return ready, velocity, cov, information, vector, position, position_cov, window, excess


@part
def _longer(pairs: Indices) -> Indices:
    longer = np.empty((2 * len(pairs), 2), np.int64)
    for k in range(len(pairs)):
        longer[k, 0], longer[k, 1] = pairs[k, 0], pairs[k, 1]
    return longer


@kernel(
    SINGLES2, WHOLES1, FLAGS1, REALS2, REALS3, REALS2, REALS3, REALS2, REALS1, REAL, REAL, REAL
)  # fmt: skip
def agreeing_pairs(
    px: Singles, by_column: Indices, ready: Flags, velocity: Reals, cov: Reals,
    position: Reals, position_cov: Reals, rotation: Reals, translation: Reals,
    focal_px: float, radius_px: float, most_chi2: float,
) -> Indices:  # fmt: skip
    """Return (P, 2) pairs that are near in the image and in depth, and agree in velocity.

    Args:
        px: (N, 2) pixels. by_column: (N,) their order by u.
        ready ... position_cov: as of ``own_motion``.
        rotation: (3, 3) and translation: (3,) metres, of T_camera_world.
        most_chi2: largest squared Mahalanobis length of the difference of two velocities.
    """
    n = len(px)
    depth, variance = np.empty(n), np.empty(n)
    for i in range(n):
        depth[i] = translation[2]
        variance[i] = 0.0
        for r in range(3):
            depth[i] += rotation[2, r] * position[i, r]
            for c in range(3):
                variance[i] += rotation[2, r] * position_cov[i, r, c] * rotation[2, c]
    pairs, found = np.empty((16 * n + 16, 2), np.int64), 0
    gap, apart, inverse = np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    for a in range(n):
        i = by_column[a]
        if not ready[i]:
            continue
        for b in range(a + 1, n):
            j = by_column[b]
            across = np.float64(px[j, 0]) - np.float64(px[i, 0])
            if across > radius_px:
                break
            down = np.float64(px[j, 1]) - np.float64(px[i, 1])
            if not ready[j] or across * across + down * down > radius_px * radius_px:
                continue
            reach = radius_px / focal_px * min(depth[i], depth[j])
            noise = _DEPTH_SIGMAS * math.sqrt(max(variance[i], 0.0) + max(variance[j], 0.0))
            # Capped, so that a point of very uncertain depth gets no neighbours by that.
            if not abs(depth[i] - depth[j]) <= reach + min(noise, reach):
                continue
            for r in range(3):
                gap[r] = velocity[i, r] - velocity[j, r]
                for c in range(3):
                    apart[r, c] = cov[i, r, c] + cov[j, r, c]
            inverse_symmetric(apart, inverse)
            if squared_length(gap, inverse) <= most_chi2:
                if found == len(pairs):
                    pairs = _longer(pairs)
                pairs[found, 0], pairs[found, 1] = min(i, j), max(i, j)
                found += 1
    return pairs[:found]


@kernel(
    FLAGS1, REALS2, REALS3, REALS2, REALS2, REALS1, WHOLES2, REAL, REALS2, REALS2, REALS1,
    REALS1, REALS1, REAL, CAMERA, REAL, REAL, REAL,
)  # fmt: skip
def pooled(
    ready: Flags, velocity: Reals, information: Reals, vector: Reals, position: Reals,
    window: Reals, pairs: Indices, correlation: float, causes: Reals, rotation: Reals,
    translation: Reals, turn: Reals, shift: Reals, dt: float, camera: Camera, corner2: float,
    bias_px: float, stretch: float,
) -> tuple[Reals, Reals, Reals, Reals, Indices]:  # fmt: skip
    """Pool the motion of N points over their neighbours.

    Args:
        ready ... window: as of ``own_motion``. pairs: (P, 2) of ``agreeing_pairs``.
        correlation: share of the noise that neighbours have in common.
        causes: (6, 6) independent errors of the camera's motion, one standard deviation each:
            rad and m, camera axes.
        rotation: (3, 3) and translation: (3,) metres, of T_camera_world.
        turn: (3,) rad/s and shift: (3,) m/s, of the camera. dt: seconds of the frame.
        corner2: as of ``lasting_errors``. bias_px, stretch: one standard deviation each, as
            ``disparity_bias_px`` and ``distortion_sigma`` of ``EvidenceParameters``.

    Returns:
        velocity (N, 3) m/s, its covariance (N, 3, 3), the part of it that all points share
        (N, 3, 3), the Mahalanobis length (N,), and how many (N,) were pooled.
    """
    n = len(ready)
    sums, total = information.copy(), vector.copy()
    squares, neighbours = np.empty(n), np.empty(n, np.int64)
    for i in range(n):
        neighbours[i] = ready[i]
        squares[i] = 0.0
        for r in range(3):
            squares[i] += velocity[i, r] * vector[i, r]
    single = squares.copy()
    for p in range(len(pairs)):
        i, j = pairs[p, 0], pairs[p, 1]
        neighbours[i] += 1
        neighbours[j] += 1
        squares[i] += single[j]
        squares[j] += single[i]
        for r in range(3):
            total[i, r] += vector[j, r]
            total[j, r] += vector[i, r]
            for c in range(3):
                sums[i, r, c] += information[j, r, c]
                sums[j, r, c] += information[i, r, c]
    out, cov, shared = np.zeros((n, 3)), np.empty((n, 3, 3)), np.empty((n, 3, 3))
    length = np.zeros(n)
    inverse, error, place = np.empty((3, 3)), np.empty((2, 3)), np.empty(3)
    common, turned = np.empty((3, 3)), np.empty((3, 3))
    for i in range(n):
        for r in range(3):
            place[r] = translation[r]
            for c in range(3):
                place[r] += rotation[r, c] * position[i, c]
        _common_errors(
            place, max(window[i], dt), causes, turn, shift, dt, camera, corner2, bias_px, stretch,
            error, common,
        )  # fmt: skip
        # In world axes: R^T S R.
        product(common, rotation, turned)
        for r in range(3):
            for c in range(3):
                shared[i, r, c] = (
                    rotation[0, r] * turned[0, c]
                    + rotation[1, r] * turned[1, c]
                    + rotation[2, r] * turned[2, c]
                )
        inflated = 1.0
        if ready[i]:
            inverse_symmetric(sums[i], cov[i])
            spread = squares[i]
            for r in range(3):
                for c in range(3):
                    out[i, r] += cov[i, r, c] * total[i, c]
                spread -= out[i, r] * total[i, r]
            others = neighbours[i] - 1
            inflated = max(1.0, spread / max(3 * others, 1)) * (1 + correlation * others)
        for r in range(3):
            for c in range(3):
                if not ready[i]:
                    cov[i, r, c] = 1.0 if r == c else 0.0
                cov[i, r, c] = cov[i, r, c] * inflated + shared[i, r, c]
        if ready[i]:
            inverse_symmetric(cov[i], inverse)
            squared = squared_length(out[i], inverse)
            if math.isfinite(squared) and squared > 0.0:
                length[i] = math.sqrt(squared)
    return out, cov, shared, length, neighbours


@part
def _common_errors(
    place: Reals, window: float, causes: Reals, turn: Reals, shift: Reals, dt: float,
    camera: Camera, corner2: float, bias_px: float, stretch: float, error: Reals, out: Reals,
) -> None:  # fmt: skip
    """Write the covariance (3, 3) of a static point's apparent velocity from shared errors.

    It is the sum of outer products of independent causes: six of the camera's own motion, whose
    errors accumulate as a random walk, and two systematic ones of the calibration.
    """
    x, y, z = place[0], place[1], place[2]
    walk = RANDOM_WALK / (dt * window)
    for r in range(3):
        for c in range(3):
            out[r, c] = 0.0
    for k in range(6):
        # A rotation by w moves the point p by w x p.
        a = causes[k, 3] + causes[k, 1] * z - causes[k, 2] * y
        b = causes[k, 4] + causes[k, 2] * x - causes[k, 0] * z
        c = causes[k, 5] + causes[k, 0] * y - causes[k, 1] * x
        out[0, 0] += walk * a * a
        out[0, 1] += walk * a * b
        out[0, 2] += walk * a * c
        out[1, 1] += walk * b * b
        out[1, 2] += walk * b * c
        out[2, 2] += walk * c * c
    lasting_error(x, y, z, 0.0, 0.0, 0.0, turn, shift, camera, corner2, error)
    for r in range(3):
        for q in range(r, 3):
            out[r, q] += bias_px * bias_px * error[0, r] * error[0, q]
            out[r, q] += stretch * stretch * error[1, r] * error[1, q]
            out[q, r] = out[r, q]
