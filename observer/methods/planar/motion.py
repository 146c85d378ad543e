"""Step 8 of the method: the displacement of each dynamic feature between the two clouds, over dt.

Both points are given in the camera frame of t: the transformation has brought the pair of t+dt
there, so static points have equal coordinates and dynamic points differ.
"""

from __future__ import annotations

import numpy as np

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose, map_pixels
from observer.methods.planar.results import PointMotions, ResidualFlow
from observer.parameters import Parameters
from observer.types import EgoMotion


def measure_motion(
    flow: ResidualFlow,
    disparity: Float64Array,
    observed_disparity: Float64Array,
    dt: float,
    ego: EgoMotion,
    camera: StereoCamera,
    parameters: Parameters,
) -> PointMotions:
    """Return the velocities of the dynamic features from their positions in the two clouds.

    Features without depth at either instant, outside the depth limits or faster than
    ``max_speed_mps`` are left out. The covariance is the measurement noise to first order:
    Lucas-Kanade's error at t+dt (the pixel at t is exact by definition) and the disparity's error
    at both instants, through the stereo Jacobian.

    Args:
        flow: all features; only the dynamic ones, M of them, are measured.
        disparity: (M,) of the dynamic features in the pair at t, NaN = unknown.
        observed_disparity: (M,) the same in the transformed pair of t+dt.
        dt: seconds between the two exposures, positive.
        ego: the planar motion by which the images were transformed. Its pose, where known, gives
            the planar model's error at each point's depth.

    Raises:
        ValueError: the ego-motion is lost.
    """
    if ego.homography is None:
        raise ValueError("the ego-motion is lost, so there is nothing to measure against")
    px = flow.px[flow.dynamic].astype(np.float64)
    observed_px = flow.observed_px[flow.dynamic].astype(np.float64)
    previous = camera.triangulate(px, disparity)
    current = camera.triangulate(observed_px, observed_disparity)
    velocity = (current - previous) / dt
    nearest, farthest = parameters.stereo.min_depth_m, parameters.stereo.max_depth_m
    with np.errstate(invalid="ignore"):
        kept = np.linalg.norm(velocity, axis=1) <= parameters.motion.max_speed_mps
        for points in (previous, current):
            kept &= (points[:, 2] >= nearest) & (points[:, 2] <= farthest)
    px, disparity, previous = px[kept], disparity[kept], previous[kept]
    observed_px, observed_disparity = observed_px[kept], observed_disparity[kept]
    sigma_px, sigma_d = parameters.motion.pixel_sigma_px, parameters.motion.disparity_sigma_px
    noise = camera.point_covariance(px, disparity, 0.0, sigma_d)
    noise = noise + camera.point_covariance(observed_px, observed_disparity, sigma_px, sigma_d)
    now_px, now_disparity = _mapped(observed_px, observed_disparity, ego.homography)
    model_error, model_error_cov = _model_error(previous, ego.homography, ego, camera)
    turn = Pose.identity() if ego.T_current_previous is None else ego.T_current_previous
    return PointMotions(
        points_previous=previous,
        points_current=current[kept],
        points_camera=camera.triangulate(now_px, now_disparity),
        px_current=now_px,
        velocity=velocity[kept],
        velocity_cov=noise / dt**2,
        point_cov=camera.point_covariance(now_px, now_disparity, sigma_px, sigma_d),
        model_error=model_error / dt,
        model_error_cov=model_error_cov / dt**2,
        R_current_previous=turn.rotation,
    )


def _mapped(
    px: Float64Array, disparity: Float64Array, homography: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Map left pixels and disparities by the homography, which is the same for left and right.

    With the ego-motion's homography, points of the transformed pair map to the original pair of
    t+dt. The new disparity is the difference of the two mapped pixels of a point.
    """
    right = px - np.stack([disparity, np.zeros_like(disparity)], axis=1)
    left, right = map_pixels(homography, px), map_pixels(homography, right)
    return left, left[:, 0] - right[:, 0]


def _model_error(
    points: Float64Array, homography: Float64Array, ego: EgoMotion, camera: StereoCamera
) -> tuple[Float64Array, Float64Array]:
    """Return the apparent displacement of static points here, (K, 3) m, and (K, 3, 3) covariance.

    The covariance is propagated from the pose's by numerical derivatives in its six components.
    """
    pose, covariance = ego.T_current_previous, ego.pose_covariance
    if pose is None or covariance is None:
        return np.full_like(points, np.nan), np.full((len(points), 3, 3), np.nan)

    back = np.asarray(np.linalg.inv(homography), dtype=np.float64)

    def seen(moved: Pose) -> Float64Array:
        px, disparity = camera.project(moved.apply(points))
        return camera.triangulate(*_mapped(px, disparity, back))

    error = seen(pose)
    # Steps of one standard deviation along each component: the scale at which the error varies.
    steps = np.sqrt(np.diag(covariance)) + 1e-9
    J = np.empty((len(points), 3, 6))
    for component, step in enumerate(steps):
        change = np.zeros(6)
        change[component] = step
        moved = Pose.from_rotvec(pose.rotvec + change[:3], pose.translation + change[3:])
        J[:, :, component] = (seen(moved) - error) / step
    return error - points, np.asarray(J @ covariance @ J.transpose(0, 2, 1), dtype=np.float64)
