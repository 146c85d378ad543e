"""Initialization from two views far enough apart, and one thing that gives the scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.methods.monocular.pose import estimate_pose
from observer.methods.monocular.rays import RayPoints
from observer.methods.monocular.scale import scale_by_ground
from observer.methods.monocular.two_views import TwoViews, inverse_distances, two_views
from observer.mount import CameraMount
from observer.parameters import MonocularParameters

NO_GROUND = "too few points on the floor are seen to tell the scale of depth by the camera's height"

_REFINE_ROUNDS = 4
# Noise of the first line of sight, px.
_FIRST_SIGMA_PX = 0.15
# Wheels that turned less than this tell no scale, metres.
_LEAST_WAY_M = 0.02
# Points less than this far below the horizon say nothing of the ground (sine of the angle).
_LEAST_SLOPE = 0.06


@dataclass(frozen=True, eq=False)
class Initialization:
    """Result of the initialization, in metres.

    Attributes:
        T_now_first: the camera's motion between them. points: those that agree, with depth.
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
    """The motion since the first view; None if not far enough, or why there is no scale.

    Args:
        first, now: (N, 3) lines of sight of the points in either camera's axes.
        driven_m: the way between both views by odometry; None where nothing tells it.
    """
    sigma = float(np.median(np.hypot(points.sigma_px, _FIRST_SIGMA_PX))) / camera.fx
    views = two_views(first, now, sigma, camera)
    if views is None:
        return None
    agreeing = points.take(views.inliers)
    first, now = first[views.inliers], now[views.inliers]
    views = _refined(agreeing, first, now, views, sigma, camera)
    inverse, noise = views.inverse, views.sigma
    if driven_m is not None and driven_m > _LEAST_WAY_M:
        log_scale, doubt = float(np.log(driven_m)), p.odometry_sigma
    elif mount is None:
        return None
    else:
        slope = first @ mount.down
        usable = (inverse > 2 * noise) & (slope > _LEAST_SLOPE)
        told = scale_by_ground(
            inverse[usable] / slope[usable], noise[usable] / inverse[usable], mount.height_m, np.inf
        )
        if told is None:
            return NO_GROUND
        log_scale, doubt = told
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


def _refined(
    points: RayPoints,
    first: Float64Array,
    now: Float64Array,
    views: TwoViews,
    sigma: float,
    camera: StereoCamera,
) -> TwoViews:
    """The same by all points at once, motion and depths in turn, the length of the way kept."""
    everything = np.ones(len(points), np.bool_)
    T, inverse, noise = views.T_second_first, views.inverse, views.sigma
    if len(inverse) != len(points):
        inverse, noise = inverse[views.inliers], noise[views.inliers]
    for _ in range(_REFINE_ROUNDS):
        broad = points.but(
            centre=np.zeros((len(points), 3)),
            ray=first,
            inverse=inverse,
            variance=(0.3 * np.abs(inverse) + noise) ** 2,
        )
        T = estimate_pose(
            broad, everything, everything.astype(np.float64), T, _length_only(T), None, 0.0, camera
        ).T_camera_world
        T = Pose(T.rotation, T.translation / np.linalg.norm(T.translation))
        inverse, noise = inverse_distances(first, now, T, sigma)
    return TwoViews(T, inverse, noise, everything)


def _length_only(T: Pose) -> Float64Array:
    """Information (6, 6) that holds the length of a way and nothing else."""
    out = np.zeros((6, 6))
    out[3:, 3:] = 1e4 * np.outer(T.translation, T.translation) / (T.translation @ T.translation)
    return out
