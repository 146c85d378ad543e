"""Steps 2 and 3 in space: track points from t to t+dt in both cameras, and triangulate them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.kernels.sightings import placed_in_world, seen_again
from observer.methods.rigid.tracked_points import TrackedPoints, WorldSightings
from observer.parameters import KltTrackingParameters
from observer.vision.klt_tracking import Sightings, as_bright_as, track_stereo_points
from observer.vision.view import View

# Pixels: smaller disparities are clamped to this, the largest depth that can be measured.
LEAST_DISPARITY_PX = 0.25
# Pixels: noise and miscalibration may make the disparity of a far point negative down to this.
MOST_NEGATIVE_PX = -2.0
# Pixels: a point that had lost its match regains it within this distance of the expected disparity.
_REGAINED_PX = 0.7


@dataclass(frozen=True, eq=False)
class Expectation:
    """Predicted image positions of N points.

    Attributes:
        px: (N, 2) float32 pixels, left image. disparity: (N,) float32 pixels, NaN unknown.
    """

    px: NDArray[np.float32]
    disparity: NDArray[np.float32]


def expected_view(
    points: TrackedPoints,
    place: Float64Array,
    T_camera_world: Pose,
    camera: StereoCamera,
    *,
    regain: bool = False,
) -> Expectation:
    """Return where points at places (N, 3) m, world, should be seen from a pose.

    Args:
        regain: also expect those in the right image whose match was lost, as after a bad image.
            Otherwise they stay without: most of them lie on depth edges.
    """
    px, disparity = camera.project(T_camera_world.apply(place))
    unknown = ~np.isfinite(px).all(axis=1)
    px[unknown] = points.px[unknown]
    if not regain:
        disparity = np.where(np.isfinite(points.disparity), disparity, np.nan)
    return Expectation(px.astype(np.float32), disparity.astype(np.float32))


def track_in_both_cameras(
    points: TrackedPoints,
    previous: View,
    view: View,
    expected: Expectation,
    dt: float,
    levels: int,
    parameters: KltTrackingParameters,
) -> Sightings:
    """Return where the points are in both images of a view, tracked from the previous one."""
    before = (as_bright_as(view.left, previous.left), as_bright_as(view.right, previous.right))
    return track_stereo_points(
        before,
        (view.left, view.right),
        points.px,
        points.right_px,
        expected.px,
        _as_exposed(points, expected, view, dt),
        levels,
        parameters,
    )


def _as_exposed(
    points: TrackedPoints, expected: Expectation, view: View, dt: float
) -> NDArray[np.float32]:
    """Return the disparities (N,) px at which points appear: the right camera may expose later."""
    if view.right_time is None:
        return expected.disparity
    flow = (expected.px[:, 0] - points.px[:, 0]) / np.float32(dt)
    return np.asarray(expected.disparity - np.float32(view.right_time - view.time) * flow)


def sighted_points(
    points: TrackedPoints,
    seen: Sightings,
    expected: Expectation,
    view: View,
    dt: float,
    parameters: KltTrackingParameters,
    camera: StereoCamera,
    bias_px: float,
) -> tuple[TrackedPoints, Float64Array]:
    """Return the points that were found, with their noise (N, 3) in u, v and disparity, pixels.

    Args:
        bias_px: to be added to all disparities, pixels at the image's centre.
    """
    at = np.flatnonzero(seen.found)
    px, right_px, flow, disparity, sigma = seen_again(
        at,
        points.px,
        points.disparity,
        expected.disparity,
        seen.px,
        seen.right_px,
        seen.sigma,
        camera.numbers,
        dt,
        parameters.scale_change_noise * parameters.window_px / 2,
        math.nan if view.right_time is None else view.right_time - view.time,
        parameters.skew_sigma_s,
        bias_px,
        MOST_NEGATIVE_PX,
        LEAST_DISPARITY_PX,
    )
    points = points.take(at)
    # Without a match before, no second path to the right image confirms the new one.
    regained = ~np.isfinite(points.disparity)
    off = np.abs(disparity - expected.disparity[at]) > _REGAINED_PX
    disparity[regained & off] = np.nan
    points = points.but(
        px=px,
        right_px=right_px,
        flow=flow,
        disparity=disparity,
        sightings=points.sightings + 1,
        age=points.age + dt,
    )
    return points, sigma


def world_sightings(
    points: TrackedPoints, sigma: Float64Array, T_world_camera: Pose, camera: StereoCamera
) -> WorldSightings:
    """Return the world positions of points seen with noise sigma (N, 3) px."""
    believed = points.sums.moving_position(points.velocity)
    return sightings_at(points.px, points.disparity, sigma, believed, T_world_camera, camera)


def sightings_at(
    px: NDArray[np.float32],
    disparity: Float64Array,
    sigma: Float64Array,
    believed: Float64Array,
    T_world_camera: Pose,
    camera: StereoCamera,
) -> WorldSightings:
    """Return the world positions of points at pixels (N, 2) with disparities (N,) px.

    Args:
        sigma: (N, 3) px, noise of u, v and disparity.
        believed: (N, 3) m, world, best estimate of the position so far; NaN unknown.
    """
    position, information = placed_in_world(
        px,
        disparity,
        sigma,
        believed,
        T_world_camera.rotation,
        T_world_camera.translation,
        camera.numbers,
    )
    return WorldSightings(position, information)
