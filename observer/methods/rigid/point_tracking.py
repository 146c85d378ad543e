"""Steps 2 and 3 in space: tracked points from t to t+dt in both cameras, and where they are now."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.methods.rigid.tracked_points import TrackedPoints, WorldSightings
from observer.parameters import KltTrackingParameters
from observer.vision.disparity_bias import bias_profile
from observer.vision.klt_tracking import Sightings, as_bright_as, track_stereo_points
from observer.vision.view import View

# Disparities below this, px, are as good as none; their points are taken to be this far away.
LEAST_DISPARITY_PX = 0.25
# Noise and miscalibration may make the disparity of a far point negative by so much, px.
MOST_NEGATIVE_PX = -2.0


@dataclass(frozen=True, eq=False)
class Expectation:
    """Predicted image positions of N points.

    Attributes:
        px: (N, 2) float32 pixels, left image. disparity: (N,) float32 pixels, NaN unknown.
    """

    px: NDArray[np.float32]
    disparity: NDArray[np.float32]


def expected_view(
    points: TrackedPoints, place: Float64Array, T_camera_world: Pose, camera: StereoCamera
) -> Expectation:
    """Return where points at places (N, 3) m, world, should be seen from a pose."""
    px, disparity = camera.project(T_camera_world.apply(place))
    unknown = ~np.isfinite(px).all(axis=1)
    px[unknown] = points.px[unknown]
    disparity = np.where(np.isfinite(points.disparity), disparity, np.nan)
    return Expectation(px.astype(np.float32), disparity.astype(np.float32))


def track_in_both_cameras(
    points: TrackedPoints,
    previous: View,
    view: View,
    expected: Expectation,
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
        expected.disparity,
        levels,
        parameters,
    )


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
        bias_px: what all disparities lack, at the image's centre.
    """
    found = seen.found
    points = points.take(found)
    px, right_px = seen.px[found], seen.right_px[found]
    flow = (px - points.px).astype(np.float64) / dt
    disparity = (px[:, 0] - right_px[:, 0]).astype(np.float64)
    growth = np.abs(expected.disparity[found] / points.disparity - 1)
    warp = parameters.scale_change_noise * parameters.window_px / 2 * np.nan_to_num(growth)
    sigma = np.empty((len(px), 3))
    sigma[:, :2] = np.hypot(seen.sigma[found, :1], warp[:, None])
    variance = seen.sigma[found, 1].astype(np.float64) ** 2
    if view.right_time is not None:
        # What moves in the image has moved on when the right camera exposes.
        disparity = disparity + flow[:, 0] * (view.right_time - view.time)
        variance = variance + (flow[:, 0] * parameters.skew_sigma_s) ** 2
    if bias_px:
        disparity = disparity + bias_px * bias_profile(px, disparity, camera)
    sigma[:, 2] = np.sqrt(variance)
    far = np.maximum(disparity, LEAST_DISPARITY_PX)
    points = points.but(
        px=px,
        right_px=right_px,
        flow=flow,
        disparity=np.where(disparity > MOST_NEGATIVE_PX, far, np.nan),
        sightings=points.sightings + 1,
        age=points.age + dt,
    )
    return points, sigma


def world_sightings(
    points: TrackedPoints, sigma: Float64Array, T_world_camera: Pose, camera: StereoCamera
) -> WorldSightings:
    """Return where points seen with noise sigma (N, 3) px are."""
    place = camera.triangulate(points.px, points.disparity)
    # The information depends on the depth; the noise of this very sighting must not decide it.
    steady = T_world_camera.inverse().apply(points.sums.moving_position(points.velocity)[0])
    use = np.isfinite(steady).all(axis=1) & (steady[:, 2] > 0)
    at = np.where(use[:, None], steady, place)
    information = sighting_information(at, sigma, T_world_camera, camera)
    known = np.asarray(np.isfinite(place).all(axis=1))
    known &= np.isfinite(information).reshape(-1, 9).all(axis=1)
    information = np.where(known[:, None, None], information, 0.0)
    return WorldSightings(
        np.where(known[:, None], T_world_camera.apply(place), np.nan), information
    )


def sighting_information(
    place: Float64Array, sigma: Float64Array, T_world_camera: Pose, camera: StereoCamera
) -> Float64Array:
    """(N, 3, 3) 1/m^2, world axes, of points (N, 3), camera frame, seen with sigma (N, 3) px."""
    J = camera.projection_jacobian(place) / sigma[..., None]
    R = T_world_camera.rotation
    return np.asarray(R @ (np.swapaxes(J, 1, 2) @ J) @ R.T, dtype=np.float64)
