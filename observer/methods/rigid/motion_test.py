"""Which points move: evidence pooled over neighbours in space, against all known errors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import gammainccinv

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose, cross_matrix, inverse_3x3
from observer.methods.rigid.point_motion import Motion
from observer.methods.rigid.tracked_points import Points
from observer.parameters import EvidenceParameters
from observer.vision.camera_rate import CameraRate
from observer.vision.chi_square import quantile
from observer.vision.neighbourhoods import false_alarms_per_test, grouped, summed

# Neighbours must agree in depth and velocity to within this many standard deviations of both.
_DEPTH_SIGMAS = 3.0
_VELOCITY_CHI2 = quantile(0.999, df=3)
# A regression over a random walk of the pose knows the slope this much worse than its step.
_RANDOM_WALK = 1.2
# Product of the three eigenvalues of an information, relative to their mean, that is not rounding;
# and their mean, relative to the sums whose difference they are.
_LEAST_RANK = 1e-12
_LEAST_REMAINDER = 1e-9


def pooled_motion(
    points: Points,
    T_camera_world: Pose,
    step_covariance: Float64Array,
    dt: float,
    camera: StereoCamera,
    parameters: EvidenceParameters,
    rate: CameraRate | None = None,
) -> Motion:
    """Test every point for motion, together with the neighbours that move as it does.

    The velocity's covariance is the inverse of the summed information, made larger for errors
    that neighbours share and for scatter beyond the noise, plus that of the camera's own motion:
    this is the same for all points, no pooling reduces it, and from frame to frame it adds up to
    a random walk. Nor does pooling or time reduce what a lasting error of the disparity does. The
    threshold is that of chi-squared at the declared rate of false alarms per frame, divided by the
    number of independent tests.

    Args:
        step_covariance: (6, 6) of the camera's motion over one frame (rad, m), camera axes.
        dt: seconds of that frame.
        rate: of the camera; left out, it stands still.
    """
    count = len(points)
    information, vector = points.sums.velocity_information()
    ready = (points.sightings >= parameters.min_sightings) & np.isfinite(vector).all(axis=1)
    # Seen along one line only, or always at one instant, a point's velocity is unknown.
    scale = np.trace(information, axis1=1, axis2=2) / 3
    ready &= scale > _LEAST_REMAINDER * np.trace(points.sums.a2, axis1=1, axis2=2)
    ready &= np.linalg.det(information) > _LEAST_RANK * scale**3
    information = np.where(ready[:, None, None], information, 0.0)
    vector = np.where(ready[:, None], vector, 0.0)
    own_cov = inverse_3x3(np.where(ready[:, None, None], information, np.eye(3)))
    velocity = np.einsum("nij,nj->ni", own_cov, vector)
    velocity[~ready] = 0.0
    position, position_cov = points.sums.moving_position(velocity, own_cov * ready[:, None, None])
    excess = points.sums.excess(position, velocity)
    information, vector = information / excess[:, None, None], vector / excess[:, None]
    own_cov, position_cov = own_cov * excess[:, None, None], position_cov * excess[:, None, None]
    pairs = _neighbours(
        points, ready, position, position_cov, velocity, own_cov, T_camera_world, camera,
        parameters,
    )  # fmt: skip
    sums = summed(pairs, [
        information.reshape(count, 9), vector, np.einsum("ni,ni->n", velocity, vector)[:, None],
        ready.astype(np.float64)[:, None],
    ])  # fmt: skip
    pooled_information = sums[:, :9].reshape(count, 3, 3)
    pooled_vector, squares, neighbours = sums[:, 9:12], sums[:, 12], sums[:, 13]
    cov = inverse_3x3(np.where(ready[:, None, None], pooled_information, np.eye(3)))
    pooled = np.einsum("nij,nj->ni", cov, pooled_vector)
    spread = squares - np.einsum("ni,ni->n", pooled, pooled_vector)
    scatter = np.maximum(1.0, spread / np.maximum(3 * (neighbours - 1), 1))
    shared = 1 + parameters.shared_error * np.maximum(neighbours - 1, 0)
    cov = cov * (scatter * shared)[:, None, None]
    window = points.sums.window_s()
    common = _common_errors(
        T_camera_world.apply(position), step_covariance, dt, np.maximum(window, dt), rate, camera,
        parameters,
    ) @ T_camera_world.rotation  # fmt: skip
    shared_cov = np.swapaxes(common, 1, 2) @ common
    cov = cov + shared_cov
    squared = np.einsum("ni,nij,nj->n", pooled, inverse_3x3(cov), pooled)
    squared = np.where(ready & np.isfinite(squared), np.maximum(squared, 0.0), 0.0)
    rate_each = false_alarms_per_test(parameters.false_alarms_per_frame, ready, neighbours)
    # The quantile of chi-squared with three degrees of freedom.
    threshold = float(np.sqrt(2 * gammainccinv(1.5, rate_each)))
    significance = np.sqrt(squared)
    return Motion(
        own_velocity=velocity,
        own_information=information,
        judged=ready,
        window_s=window,
        position=position,
        position_cov=position_cov,
        shared_cov=shared_cov,
        velocity=pooled,
        covariance=cov,
        significance=significance,
        neighbours=neighbours.astype(np.int64),
        threshold=threshold,
        dynamic=(significance > threshold) & (neighbours >= parameters.min_points),
        pairs=pairs,
    )


def group_dynamic(motion: Motion, free: NDArray[np.bool_], min_points: int) -> NDArray[np.int64]:
    """Number the groups of dynamic points that hang together in place and velocity.

    Args:
        free: (N,) which points may be grouped.

    Returns:
        (N,) group number from 0, largest group first; -1 for all other points.
    """
    return grouped(motion.pairs, motion.dynamic & free, min_points)


def _neighbours(
    points: Points,
    ready: NDArray[np.bool_],
    position: Float64Array,
    place_cov: Float64Array,
    velocity: Float64Array,
    covariance: Float64Array,
    T_camera_world: Pose,
    camera: StereoCamera,
    parameters: EvidenceParameters,
) -> NDArray[np.intp]:
    """(P, 2) pairs that are near in the image and in depth, and may have one velocity."""
    if len(points) < 2:
        return np.zeros((0, 2), np.intp)
    found = cKDTree(points.px).query_pairs(parameters.radius_px, output_type="ndarray")
    i, j = found[:, 0], found[:, 1]
    depth = T_camera_world.apply(position)[:, 2]
    forward = T_camera_world.rotation[2]
    variance = np.einsum("i,nij,j->n", forward, place_cov, forward)
    reach = parameters.radius_px / camera.fx * np.minimum(depth[i], depth[j])
    # What was not judged has no variance to speak of, and is left out below.
    variance = np.where(ready & (variance > 0), variance, 0.0)
    noise = _DEPTH_SIGMAS * np.sqrt(variance[i] + variance[j])
    # What may be anywhere in depth is nobody's neighbour.
    allowed = reach + np.minimum(noise, reach)
    near = ready[i] & ready[j] & (np.abs(depth[i] - depth[j]) <= allowed)
    i, j = i[near], j[near]
    gap = velocity.take(i, axis=0) - velocity.take(j, axis=0)
    apart = covariance.take(i, axis=0) + covariance.take(j, axis=0)
    squared = np.einsum("pi,pij,pj->p", gap, inverse_3x3(apart), gap)
    agree = squared <= _VELOCITY_CHI2
    return np.stack([i[agree], j[agree]], axis=1)


def _common_errors(
    place: Float64Array,
    step_covariance: Float64Array,
    dt: float,
    window: Float64Array,
    rate: CameraRate | None,
    camera: StereoCamera,
    parameters: EvidenceParameters,
) -> Float64Array:
    """(N, 8, 3) m/s, camera axes: how static points seem to move by errors they share.

    Each is that of one independent cause of one standard deviation: six of the camera's own
    motion, whose covariance is the sum of their products, and the calibration's two.

    Args:
        place: (N, 3) metres, camera frame. window: (N,) seconds over which it was sighted.
    """
    out = np.zeros((len(place), 8, 3))
    values, axes = np.linalg.eigh(step_covariance)
    causes = (axes * np.sqrt(np.maximum(values, 0.0))).T
    # A turn by w moves the point p by w x p = -[p]x w; here for all six causes at once.
    turning = -cross_matrix(causes[:, :3]).transpose(2, 0, 1).reshape(3, 18)
    moved = (causes[:, 3:].reshape(18) - place @ turning).reshape(-1, 6, 3)
    out[:, :6] = moved * np.sqrt(_RANDOM_WALK / (dt * window))[:, None, None]
    if rate is not None:
        out[:, 6:] = rate.lasting_errors(
            place, np.zeros_like(place), camera, parameters.disparity_bias_px, parameters.stretch
        )
    return out
