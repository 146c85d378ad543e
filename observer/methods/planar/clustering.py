"""Step 9 of the method, first half: group the dynamic points into obstacles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from observer.geometry import Float64Array, mahalanobis
from observer.methods.planar.results import Detection, PointMotions
from observer.parameters import ClusteringParameters, MotionParameters
from observer.robust import MAD_TO_SIGMA

# Two measurements of one surface differ along the ray by less than this many standard deviations.
_DEPTH_SIGMAS = 2.0
# Times the radius: beyond this a neighbourhood means nothing, however noisy the depth.
_MAX_STRETCH = 10.0
_OUTLIER_SIGMAS = 3.0


def group_points(
    points: Float64Array, depth_sigma: Float64Array, parameters: ClusteringParameters
) -> NDArray[np.int_]:
    """Number the groups of connected points.

    Two points are neighbours if their distance is below the radius; along the line of sight the
    radius is widened by the noise of their depths.

    Args:
        points: (K, 3) metres, camera frame. depth_sigma: (K,) metres, one standard deviation.

    Returns:
        (K,) group number from 0, nearest group first; -1 for points in groups that are too small.
    """
    count = len(points)
    if count == 0:
        return np.empty(0, np.int_)
    radius = parameters.radius_m
    noise = np.minimum(_DEPTH_SIGMAS * depth_sigma, _MAX_STRETCH * radius)
    reach = float(np.hypot(radius, np.sqrt(2) * noise.max()))
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    i, j = pairs[:, 0], pairs[:, 1]
    gap = points[i] - points[j]
    ray = points[i] + points[j]
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    along = np.einsum("ij,ij->i", gap, ray)
    across2 = np.einsum("ij,ij->i", gap, gap) - along**2
    along2_allowed = radius**2 + noise[i] ** 2 + noise[j] ** 2
    near = across2 / radius**2 + along**2 / along2_allowed <= 1.0
    graph = coo_matrix(
        (np.ones(np.count_nonzero(near), np.int8), (i[near], j[near])), shape=(count, count)
    )
    _, labels = connected_components(graph, directed=False)
    sizes = np.bincount(labels)
    depth = np.bincount(labels, weights=points[:, 2]) / sizes
    depth[sizes < parameters.min_points] = np.inf
    number = np.empty(len(sizes), np.int_)
    number[np.argsort(depth, kind="stable")] = np.arange(len(sizes))
    number[~np.isfinite(depth)] = -1
    return np.asarray(number[labels], dtype=np.int_)


def detect_obstacles(
    motions: PointMotions,
    velocity_time: float,
    clustering: ClusteringParameters,
    motion: MotionParameters,
) -> tuple[Detection, ...]:
    """Return the groups of dynamic points with position, box and velocity, nearest first.

    Groups whose velocity is below ``motion.min_significance`` are left out.

    Args:
        velocity_time: the instant the velocities belong to, source clock, seconds.
    """
    depth_sigma = np.sqrt(motions.point_cov[:, 2, 2])
    labels = group_points(motions.points_camera, depth_sigma, clustering)
    detections = (
        _describe(motions, np.flatnonzero(labels == number), velocity_time, motion)
        for number in range(labels.max(initial=-1) + 1)
    )
    return tuple(d for d in detections if d.significance >= motion.min_significance)


def _describe(
    motions: PointMotions, members: NDArray[np.intp], time: float, parameters: MotionParameters
) -> Detection:
    # The displacements are in the axes of the earlier frame, the obstacle is in those of this one.
    R = motions.R_current_previous
    velocities = motions.velocity[members] @ R.T
    covariances = R @ motions.velocity_cov[members] @ R.T
    agree = _agree(velocities, covariances)
    members, velocities, covariances = members[agree], velocities[agree], covariances[agree]
    count = len(members)
    # Errors of neighbouring points are correlated (the matcher's blocks overlap); averaging does
    # not reduce the common part.
    shrink = (1 - parameters.noise_correlation) / count + parameters.noise_correlation
    velocity = velocities.mean(axis=0)
    noise = _at_least_the_scatter(velocities, covariances) * shrink
    bias = R @ motions.model_error[members].mean(axis=0)
    known = bool(np.isfinite(bias).all())
    against = noise
    if known:
        common = R @ motions.model_error_cov[members].mean(axis=0) @ R.T
        against = noise + np.outer(bias, bias) + common
    points = motions.points_camera[members]
    position_cov = motions.point_cov[members].mean(axis=0) * shrink
    position_cov = position_cov + np.atleast_2d(np.cov(points.T, bias=True)) / count
    size = np.ptp(points, axis=0)
    px = motions.px_current[members]
    box = (*px.min(axis=0).tolist(), *px.max(axis=0).tolist())
    return Detection(
        position=points.mean(axis=0),
        position_cov=position_cov,
        velocity=velocity,
        velocity_cov=against + _unseen_turn(size, parameters) if known else None,
        velocity_time=time,
        size=size,
        points=count,
        significance=mahalanobis(velocity, against),
        box_px=(box[0], box[1], box[2], box[3]),
    )


def _unseen_turn(size: Float64Array, parameters: MotionParameters) -> Float64Array:
    """Return the (3, 3) covariance of the centre's velocity relative to the visible side.

    Turning about the vertical moves the visible side relative to the centre by the turn rate
    times their distance, taken as half of the visible extent. It does not reduce the
    significance: a body that turns does move.
    """
    sideways = parameters.turn_sigma_radps * float(np.hypot(size[0], size[2])) / 2
    return np.diag([sideways**2, 0.0, sideways**2])


def _at_least_the_scatter(velocity: Float64Array, covariance: Float64Array) -> Float64Array:
    """Return the (3, 3) noise of one point, widened along each axis to the observed scatter.

    Flow that mixes an obstacle with what lies behind it scatters more than its noise.
    """
    stated = covariance.mean(axis=0)
    widening = np.sqrt(np.maximum(velocity.var(axis=0) / np.diag(stated), 1.0))
    return np.asarray(stated * np.outer(widening, widening), dtype=np.float64)


def _agree(velocity: Float64Array, covariance: Float64Array) -> NDArray[np.bool_]:
    """(K,) which points move at the median velocity within their noise; all if none does."""
    gap = velocity - np.median(velocity, axis=0)
    # At least the observed scatter, so that along each axis half of the points always agree.
    scatter = MAD_TO_SIGMA * np.median(np.abs(gap), axis=0)
    sigma = np.maximum(np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)), scatter)
    agree = np.asarray((np.abs(gap) <= _OUTLIER_SIGMAS * sigma).all(axis=1), dtype=np.bool_)
    return agree if agree.any() else np.ones_like(agree)
