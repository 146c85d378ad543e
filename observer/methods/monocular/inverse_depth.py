"""Depth from motion: each point's inverse depth from all its lines of sight, if it is static."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose, cross_matrix
from observer.methods.monocular.rays import RayPoints

# Noise of the anchor's own line of sight, px, and drift of a tracked point, px per root second:
# it is tracked from frame to frame, so its errors add up.
_ANCHOR_SIGMA_PX = 0.08
_DRIFT_PX = 0.12
_TRUSTED_CHI2 = 9.0
# Metres: nearest and farthest distance allowed for a point.
NEAREST_M, FARTHEST_M = 0.15, 60.0


@dataclass(frozen=True, eq=False)
class Expected:
    """Predicted sightings of N static points from a pose.

    Attributes:
        px: (N, 2) pixels; NaN behind the camera. by_inverse: (N, 2) px m, derivative by the
            inverse depth. by_pose: (N, 2, 6) derivative by a small rotation (rad) and translation
            (m) of the points in the camera's axes.
    """

    px: Float64Array
    by_inverse: Float64Array
    by_pose: Float64Array


def lines_of_sight(
    px: NDArray[np.float32], T_world_camera: Pose, camera: StereoCamera
) -> Float64Array:
    """(N, 3) unit vectors, world, through pixels (N, 2)."""
    ray = np.empty((len(px), 3))
    ray[:, 0] = (px[:, 0] - camera.cx) / camera.fx
    ray[:, 1] = (px[:, 1] - camera.cy) / camera.fy
    ray[:, 2] = 1.0
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    return T_world_camera.rotate(ray)


def expected_sightings(points: RayPoints, T_camera_world: Pose, camera: StereoCamera) -> Expected:
    """Predict the sightings of static points, with derivatives by inverse depth and pose."""
    # Points are scaled by their inverse depth, so that points at infinity work too.
    gap = T_camera_world.apply(points.centre)
    inverse = np.clip(points.inverse, 1 / FARTHEST_M**2, 1 / NEAREST_M)
    p = T_camera_world.rotate(points.ray) + inverse[:, None] * gap
    front = np.asarray(p[:, 2] > 1e-3)
    w = np.where(front, 1 / np.where(front, p[:, 2], 1.0), np.nan)
    px = np.stack([camera.fx * p[:, 0] * w + camera.cx, camera.fy * p[:, 1] * w + camera.cy], 1)
    J = np.zeros((len(p), 2, 3))
    J[:, 0, 0], J[:, 0, 2] = camera.fx * w, -camera.fx * p[:, 0] * w * w
    J[:, 1, 1], J[:, 1, 2] = camera.fy * w, -camera.fy * p[:, 1] * w * w
    by_inverse = np.einsum("nij,nj->ni", J, gap)
    by_pose = np.concatenate([-J @ cross_matrix(p), J * inverse[:, None, None]], axis=2)
    return Expected(px, by_inverse, by_pose)


def sighting_noise(points: RayPoints) -> Float64Array:
    """(N,) px^2: variance of a sighting relative to the point's anchor."""
    drift = _DRIFT_PX**2 * points.anchor_s
    return np.asarray(points.sigma_px**2 + _ANCHOR_SIGMA_PX**2 + drift, np.float64)


def updated(
    points: RayPoints,
    T_camera_world: Pose,
    pose_covariance: Float64Array,
    noise_scale: float,
    camera: StereoCamera,
) -> RayPoints:
    """Return the points updated with this frame's sightings, with the remaining residuals.

    All sightings share the noise of the anchor, which limits how well inverse depth can be known.
    The variance is therefore kept above half of what the newest sighting alone gives.

    Args:
        pose_covariance: (6, 6) of the pose (rad, m). noise_scale: of the pixels' noise.
    """
    seen = expected_sightings(points, T_camera_world, camera)
    innovation = points.px - seen.px
    noise = sighting_noise(points) * noise_scale**2
    H = seen.by_inverse
    swing = seen.by_pose @ pose_covariance @ np.swapaxes(seen.by_pose, 1, 2)
    R = noise[:, None, None] * np.eye(2) + swing
    S = R + points.variance[:, None, None] * (H[:, :, None] * H[:, None, :])
    good = np.asarray(np.isfinite(innovation).all(axis=1) & np.isfinite(S).all(axis=(1, 2)))
    S = np.where(good[:, None, None], S, np.eye(2))
    W = inverse_2x2(S)
    H, innovation = np.where(good[:, None], H, 0.0), np.where(good[:, None], innovation, 0.0)
    WH = np.einsum("nij,nj->ni", W, H)
    # Down-weight misfits, so that a moving point does not get a seemingly certain depth.
    squared = np.einsum("ni,nij,nj->n", innovation, W, innovation)
    trust = np.minimum(1.0, _TRUSTED_CHI2 / np.maximum(squared, 1e-12))
    gain = (trust * points.variance)[:, None] * WH
    inverse = points.inverse + np.einsum("ni,ni->n", gain, innovation)
    inverse = np.clip(inverse, -1 / NEAREST_M, 1 / NEAREST_M)
    information = trust * np.einsum("ni,ni->n", H, WH)
    variance = points.variance * (1 - points.variance * information)
    R_good = np.where(good[:, None, None], R, np.eye(2))
    alone = np.einsum("ni,nij,nj->n", H, inverse_2x2(R_good), H)
    variance = np.maximum(variance, np.minimum(points.variance, 0.5 / np.maximum(alone, 1e-12)))
    after = points.but(inverse=inverse, variance=variance)
    left = points.px - expected_sightings(after, T_camera_world, camera).px
    cov = noise[:, None, None] * np.eye(2) + variance[:, None, None] * H[:, :, None] * H[:, None, :]
    left = np.where(np.isfinite(left) & good[:, None], left, 0.0)
    return after.but(residual=left, residual_cov=cov)


def anchored_anew(
    points: RayPoints, which: NDArray[np.bool_], T_world_camera: Pose, camera: StereoCamera
) -> RayPoints:
    """Return the points, those in ``which`` (N,) re-anchored at the camera's pose now.

    Their inverse depths are carried over.
    """
    centre = T_world_camera.translation
    ray = lines_of_sight(points.px, T_world_camera, camera)
    ahead = points.ray + points.inverse[:, None] * (points.centre - centre)
    length = np.maximum(np.linalg.norm(ahead, axis=1), 1e-6)
    inverse = points.inverse / length
    advance = np.einsum("ni,ni->n", points.ray, centre - points.centre)
    slope = 1 / np.maximum(np.abs(1 - points.inverse * advance), 0.05) ** 2
    pick = which[:, None]
    return points.but(
        centre=np.where(pick, centre, points.centre),
        ray=np.where(pick, ray, points.ray),
        anchor_s=np.where(which, 0.0, points.anchor_s),
        residual=np.where(pick, 0.0, points.residual),
        inverse=np.where(which, inverse, points.inverse),
        variance=np.where(which, points.variance * slope**2, points.variance),
    )


def inverse_2x2(m: Float64Array) -> Float64Array:
    """Inverses (N, 2, 2) of symmetric matrices (N, 2, 2)."""
    a, b, d = m[:, 0, 0], m[:, 0, 1], m[:, 1, 1]
    out = np.empty_like(m)
    out[:, 0, 0], out[:, 1, 1] = d, a
    out[:, 0, 1] = out[:, 1, 0] = -b
    determinant = a * d - b * b
    return out / np.where(np.abs(determinant) > 1e-300, determinant, np.nan)[:, None, None]
