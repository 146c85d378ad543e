"""Oracle of ``observer.kernels.sightings``: all points at once, by numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.vision.disparity_bias import bias_profile

from ...builders import projection_jacobian


def seen_again(
    found: NDArray[np.bool_],
    before_px: NDArray[np.float32],
    before_disparity: Float64Array,
    expected_disparity: NDArray[np.float32],
    seen_px: NDArray[np.float32],
    right_px: NDArray[np.float32],
    match_sigma: NDArray[np.float32],
    camera: StereoCamera,
    dt: float,
    warp_px: float,
    skew_s: float | None,
    skew_sigma_s: float,
    bias_px: float,
    most_negative_px: float,
    least_px: float,
) -> tuple[NDArray[np.float32], NDArray[np.float32], Float64Array, Float64Array, Float64Array]:
    """Pixels (M, 2) in both images, flow (M, 2), disparity (M,) and sigma (M, 3) of those found."""
    px, right_px = seen_px[found], right_px[found]
    flow = (px - before_px[found]).astype(np.float64) / dt
    disparity = (px[:, 0] - right_px[:, 0]).astype(np.float64)
    growth = np.abs(expected_disparity[found] / before_disparity[found] - 1)
    warp = warp_px * np.nan_to_num(growth)
    sigma = np.empty((len(px), 3))
    sigma[:, :2] = np.hypot(match_sigma[found, :1], warp[:, None])
    variance = match_sigma[found, 1].astype(np.float64) ** 2
    if skew_s is not None:
        disparity = disparity + flow[:, 0] * skew_s
        variance = variance + (flow[:, 0] * skew_sigma_s) ** 2
    if bias_px:
        disparity = disparity + bias_px * bias_profile(px, disparity, camera)
    sigma[:, 2] = np.sqrt(variance)
    far = np.maximum(disparity, least_px)
    return px, right_px, flow, np.where(disparity > most_negative_px, far, np.nan), sigma


def placed_in_world(
    px: NDArray[np.float32],
    disparity: Float64Array,
    sigma: Float64Array,
    believed: Float64Array,
    T_world_camera: Pose,
    camera: StereoCamera,
) -> tuple[Float64Array, Float64Array]:
    """Positions (N, 3) m, world, and information (N, 3, 3) 1/m^2 of points."""
    place = camera.triangulate(px, disparity)
    steady = T_world_camera.inverse().apply(believed)
    use = np.isfinite(steady).all(axis=1) & (steady[:, 2] > 0)
    at = np.where(use[:, None], steady, place)
    J = projection_jacobian(camera, at) / sigma[..., None]
    R = T_world_camera.rotation
    information = R @ (np.swapaxes(J, 1, 2) @ J) @ R.T
    finite = np.column_stack([np.isfinite(place), np.isfinite(information).reshape(-1, 9)])
    known = np.asarray(finite.all(axis=1))
    information = np.where(known[:, None, None], information, 0.0)
    return np.where(known[:, None], T_world_camera.apply(place), np.nan), information
