"""Initialization from two views far enough apart, and one source of scale.

The scale comes from odometry, from points on the ground at a known height, or from the ground's
appearance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.methods.monocular.ground_alignment import GroundMotion
from observer.methods.monocular.pose import difference, estimate_pose
from observer.methods.monocular.rays import RayPoints
from observer.methods.monocular.scale import scale_by_ground
from observer.methods.monocular.two_views import TwoViews, inverse_distances, two_views
from observer.mount import CameraMount
from observer.parameters import MonocularParameters
from observer.vision.klt_tracking import TYPICAL_SIGMA_PX

NO_GROUND = (
    "too few points on the ground are visible to determine the scale from the camera's height"
)

_REFINE_ROUNDS = 4
# Metres: a shorter distance by wheel odometry gives no scale.
_LEAST_DISTANCE_M = 0.02
# A distance measured from the ground must be at least this long, metres, and its sigma at most
# this share of it.
_LEAST_GROUND_DISTANCE_M, _LARGEST_GROUND_SIGMA = 0.05, 0.06
# The points must agree with the ground's motion to within this many standard deviations, and this
# share of them must be inliers of the resulting motion.
_AGREEING_SIGMAS, _AGREEING_SHARE = 5.0, 0.6
# Of the points with clear parallax, in standard deviations, at least this share lies in front.
_CLEAR_SIGMAS, _IN_FRONT_SHARE = 2.0, 0.8
# Sine of the angle below the horizon: points above this say nothing about the ground.
_LEAST_SLOPE = 0.06


@dataclass(frozen=True, eq=False)
class Initialization:
    """Result of the initialization, in metres.

    Attributes:
        T_now_first: the camera's motion between the views. points: the inliers, with depth.
        scale_sigma: of all lengths, as a share.
    """

    T_now_first: Pose
    points: RayPoints
    scale_sigma: float


def initialize_from_two_views(
    points: RayPoints,
    first: Float64Array,
    now: Float64Array,
    driven_m: float | None,
    mount: CameraMount | None,
    p: MonocularParameters,
    camera: StereoCamera,
) -> Initialization | str | None:
    """Return motion and depths since the first view, or the reason why there is no scale.

    None if the points do not agree on a motion, or nothing gives the scale.

    Args:
        first, now: (N, 3) lines of sight of the points, each in its own camera's axes.
        driven_m: distance between both views by odometry; None if unknown.
    """
    sigma = _sight_sigma(points, camera)
    views = two_views(first, now, sigma, camera)
    if views is None:
        return None
    agreeing = points.take(views.inliers)
    first, now = first[views.inliers], now[views.inliers]
    views = _refined(agreeing, first, now, views, sigma, camera)
    inverse, noise = views.inverse, views.sigma
    if driven_m is not None and driven_m > _LEAST_DISTANCE_M:
        log_scale, doubt = float(np.log(driven_m)), p.odometry_sigma
    elif mount is None:
        return None
    else:
        slope = first @ mount.down
        usable = (inverse > 2 * noise) & (slope > _LEAST_SLOPE)
        measured = scale_by_ground(
            inverse[usable] / slope[usable], noise[usable] / inverse[usable], mount.height_m, np.inf
        )
        if measured is None:
            return NO_GROUND
        log_scale, doubt = measured
    metres = float(np.exp(log_scale))
    good = inverse > noise
    T = views.T_second_first
    return Initialization(
        Pose(T.rotation, metres * T.translation),
        agreeing.take(good).but(
            inverse=inverse[good] / metres, variance=(noise[good] / metres) ** 2
        ),
        doubt,
    )


def initialize_over_ground(
    points: RayPoints,
    first: Float64Array,
    now: Float64Array,
    motion: GroundMotion,
    camera: StereoCamera,
) -> Initialization | None:
    """Return motion and depths since the first view, with the motion measured from the ground.

    None if that motion is not certain enough yet, or points contradict it.

    Args:
        first, now: (N, 3) lines of sight of the points, each in its own camera's axes.
        motion: since the first view.
    """
    if (
        motion.distance_m < _LEAST_GROUND_DISTANCE_M
        or motion.distance_sigma > _LARGEST_GROUND_SIGMA
    ):
        return None
    sigma = _sight_sigma(points, camera)
    everything = np.ones(len(points), np.bool_)
    prior = np.asarray(np.linalg.pinv(motion.covariance), np.float64)
    T = motion.T_now_mark
    for _ in range(_REFINE_ROUNDS):
        inverse, noise = inverse_distances(first, now, T, sigma)
        estimate = estimate_pose(
            _broad(points, first, inverse, noise), everything, everything.astype(np.float64),
            motion.T_now_mark, prior, None, 0.0, camera,
        )  # fmt: skip
        T = estimate.T_camera_world
    gap = difference(motion.T_now_mark, T)
    if gap @ prior @ gap > _AGREEING_SIGMAS**2:
        return None
    if np.mean(estimate.inliers) < _AGREEING_SHARE:
        return None
    inverse, noise = inverse_distances(first, now, T, sigma)
    clear = estimate.inliers & (np.abs(inverse) > _CLEAR_SIGMAS * noise)
    if np.count_nonzero(clear & (inverse > 0)) < _IN_FRONT_SHARE * np.count_nonzero(clear):
        # What was taken for the ground was an object driving away.
        return None
    # The other points keep the prior of new points.
    measured = (inverse > 0) & (noise**2 < points.variance)
    placed = points.but(
        inverse=np.where(measured, inverse, points.inverse),
        variance=np.where(measured, noise**2, points.variance),
    )
    return Initialization(T, placed.take(estimate.inliers), motion.distance_sigma)


def _sight_sigma(points: RayPoints, camera: StereoCamera) -> float:
    """Return the noise of a line of sight, radians."""
    return float(np.median(np.hypot(points.sigma_px, TYPICAL_SIGMA_PX))) / camera.fx


def _broad(
    points: RayPoints, first: Float64Array, inverse: Float64Array, noise: Float64Array
) -> RayPoints:
    """Return the points on their first lines of sight (N, 3), with very uncertain depths."""
    return points.but(
        centre=np.zeros((len(points), 3)),
        ray=first,
        inverse=inverse,
        variance=(0.3 * np.abs(inverse) + noise) ** 2,
    )


def _refined(
    points: RayPoints,
    first: Float64Array,
    now: Float64Array,
    views: TwoViews,
    sigma: float,
    camera: StereoCamera,
) -> TwoViews:
    """Refine motion and depths in turn with all points, keeping the baseline's length."""
    everything = np.ones(len(points), np.bool_)
    T, inverse, noise = views.T_second_first, views.inverse, views.sigma
    if len(inverse) != len(points):
        inverse, noise = inverse[views.inliers], noise[views.inliers]
    for _ in range(_REFINE_ROUNDS):
        broad = _broad(points, first, inverse, noise)
        T = estimate_pose(
            broad, everything, everything.astype(np.float64), T, _length_only(T), None, 0.0, camera
        ).T_camera_world
        T = Pose(T.rotation, T.translation / np.linalg.norm(T.translation))
        inverse, noise = inverse_distances(first, now, T, sigma)
    return TwoViews(T, inverse, noise, everything)


def _length_only(T: Pose) -> Float64Array:
    """Return the information (6, 6) that fixes the length of a translation and nothing else."""
    out = np.zeros((6, 6))
    out[3:, 3:] = 1e4 * np.outer(T.translation, T.translation) / (T.translation @ T.translation)
    return out
