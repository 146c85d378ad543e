"""Motion test for one camera: moving points leave their epipolar line or seem below the ground.

Evidence is pooled over neighbours in the image that move alike, against a declared rate of false
alarms, as with two cameras. Motion along the line of sight is not detected here, but by a depth
that contradicts the ground contact (``floating``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import ndtri

from observer.camera import StereoCamera
from observer.chi_square import upper_quantile
from observer.geometry import Float64Array, Pose
from observer.kernels.motion_test import RANDOM_WALK
from observer.methods.monocular.ground import GroundPlane
from observer.methods.monocular.inverse_depth import expected_sightings, inverse_2x2
from observer.methods.monocular.rays import DEPTH_SHARED, RayPoints
from observer.parameters import EvidenceParameters
from observer.vision.neighbourhoods import false_alarms_per_test, summed

# Neighbours move alike in the image to within this many pixels per frame, plus this share.
_ALIKE_PX, _ALIKE_SHARE = 0.6, 0.1
_LEAST_ANCHOR_S = 0.25
# A point below the ground is farther than the ground by a margin: a share of the ground's inverse
# distance, and in 1 / camera heights. Most of its neighbours must each be so too.
_FLOOR_SHARE, _SLACK = 0.8, 0.02
_MOST, _EACH_SIGMAS = 0.7, 2.0


@dataclass(frozen=True, eq=False)
class RayEvidence:
    """Motion of N points in the image beyond that of static ones.

    Attributes:
        significance: (N,) standard deviations; 0 where it was not tested.
        threshold: significance above which a point counts as moving.
        moving: (N,). neighbours: (N,) how many points were pooled. pairs: (P, 2) indices of
            neighbours that move alike.
    """

    significance: Float64Array
    threshold: float
    moving: NDArray[np.bool_]
    neighbours: NDArray[np.int64]
    pairs: NDArray[np.intp]


def ray_evidence(
    points: RayPoints,
    T_camera_world: Pose,
    step_covariance: Float64Array,
    dt: float,
    ground: GroundPlane | None,
    tilt_sigma: float,
    camera: StereoCamera,
    parameters: EvidenceParameters,
) -> RayEvidence:
    """Test every point for motion, together with its neighbours.

    Args:
        points: after this frame's update, which scaled their covariances to the noise learnt.
        step_covariance: (6, 6) of the camera's motion over one frame of ``dt`` seconds.
        tilt_sigma: rad, of the ground relative to the camera.
    """
    count = len(points)
    ready = (points.sightings >= parameters.min_sightings) & (points.anchor_s >= _LEAST_ANCHOR_S)
    ready &= np.isfinite(points.residual).all(axis=1)
    age = np.maximum(points.anchor_s, dt)
    velocity = points.residual / age[:, None]
    cov = points.residual_cov / (age**2)[:, None, None]
    W = np.where(ready[:, None, None], inverse_2x2(cov), 0.0)
    pairs = _neighbours(points, ready, parameters.radius_px)
    information_vector = np.einsum("nij,nj->ni", W, velocity)
    bound, slack = np.zeros(count), 0.0
    if ground is not None:
        bound = ground.inverse_distance(points.centre, points.ray)
        slack = _SLACK / ground.depth
    # The margin keeps ground points from seeming below the ground through errors of scale and tilt.
    excess = _FLOOR_SHARE * np.maximum(bound, 0.0) - slack - points.inverse
    depth_weight = ready / np.maximum(DEPTH_SHARED * points.variance, 1e-12)
    beyond = ready & (excess * np.sqrt(depth_weight) > _EACH_SIGMAS)
    singles = [
        np.einsum("ni,ni->n", velocity, information_vector),
        ready,
        depth_weight,
        depth_weight * excess,
    ]
    sums = summed(
        pairs, [W.reshape(count, 4), information_vector, np.column_stack([*singles, beyond])]
    )
    neighbours = sums[:, 7]
    shared = 1 + parameters.noise_correlation * np.maximum(neighbours - 1, 0)
    C = inverse_2x2(np.where(ready[:, None, None], sums[:, :4].reshape(count, 2, 2), np.eye(2)))
    pooled = np.einsum("nij,nj->ni", C, sums[:, 4:6])
    spread = sums[:, 6] - np.einsum("ni,ni->n", pooled, sums[:, 4:6])
    scatter = np.maximum(1.0, spread / np.maximum(2 * (neighbours - 1), 1))
    J = np.nan_to_num(expected_sightings(points, T_camera_world, camera).by_pose)
    ego = J @ step_covariance @ np.swapaxes(J, 1, 2) * (RANDOM_WALK / (dt * age))[:, None, None]
    C = C * (scatter * shared)[:, None, None] + ego
    squared = np.einsum("ni,nij,nj->n", pooled, inverse_2x2(C), pooled)
    squared = np.where(ready & np.isfinite(squared), np.maximum(squared, 0.0), 0.0)
    below = _below_ground(sums[:, 8], sums[:, 9], shared, tilt_sigma, ground, ready)
    rate = false_alarms_per_test(parameters.false_alarms_per_frame, ready, neighbours)
    threshold = float(np.sqrt(upper_quantile(rate, df=2)))
    below *= threshold / float(-ndtri(rate))
    below = np.where(sums[:, 10] >= _MOST * neighbours, below, 0.0)
    significance = np.maximum(np.sqrt(squared), below)
    return RayEvidence(
        significance=significance,
        threshold=threshold,
        moving=(significance > threshold) & (neighbours >= parameters.min_points),
        neighbours=neighbours.astype(np.int64),
        pairs=pairs,
    )


def _below_ground(
    weight: Float64Array,
    weighted: Float64Array,
    inflation: Float64Array,
    tilt_sigma: float,
    ground: GroundPlane | None,
    ready: NDArray[np.bool_],
) -> Float64Array:
    """(N,) standard deviations by which points lie beyond the ground, or beyond infinity."""
    mean = weighted / np.maximum(weight, 1e-12)
    variance = inflation / np.maximum(weight, 1e-12)
    if ground is not None:
        variance = variance + (tilt_sigma / max(ground.depth, 1e-6)) ** 2
    return np.where(ready, np.maximum(mean, 0.0) / np.sqrt(variance), 0.0)


def _neighbours(points: RayPoints, ready: NDArray[np.bool_], radius_px: float) -> NDArray[np.intp]:
    """(P, 2) pairs of points near each other in the image that move alike there."""
    if len(points) < 2:
        return np.zeros((0, 2), np.intp)
    found = cKDTree(points.px).query_pairs(radius_px, output_type="ndarray")
    found = found[ready[found].all(axis=1)]
    i, j = found[:, 0], found[:, 1]
    flow = (points.px - points.before_px).astype(np.float64)
    gap = np.linalg.norm(flow[i] - flow[j], axis=1)
    room = _ALIKE_PX + _ALIKE_SHARE * np.linalg.norm(flow[i], axis=1)
    return np.asarray(found[gap <= room])
