"""Stereo images and point clouds generated from known ground truth."""

from __future__ import annotations

from typing import Any

import numpy as np

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.methods.rigid.position_velocity_filter import PositionVelocityFilter
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.types import Image, MotionState, Obstacle, TrackState

LAB = StereoCamera(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)
ROAD = StereoCamera(1242, 375, 707.0, 707.0, 601.0, 183.0, 0.54)


class Texture:
    """Random grey levels with no detail finer than a few pixels, on an endless periodic plane.

    Moving it shifts the phases of its waves, which is exact for any fraction of a pixel.

    Args:
        finest_px, coarsest_px: wavelengths between which it has structure.
        contrast: standard deviation in grey levels.
    """

    def __init__(
        self,
        seed: int,
        shape: tuple[int, int] = (160, 256),
        finest_px: float = 5.0,
        coarsest_px: float = 40.0,
        contrast: float = 40.0,
    ) -> None:
        self._v = np.fft.fftfreq(shape[0])[:, None]
        self._u = np.fft.rfftfreq(shape[1])[None]
        frequency = np.hypot(self._u, self._v)
        band = (frequency <= 1 / finest_px) & (frequency >= 1 / coarsest_px)
        noise = np.fft.rfft2(np.random.default_rng(seed).normal(size=shape)) * band
        self._waves = noise * contrast / np.fft.irfft2(noise, shape).std()
        self._shape = shape

    def moved(self, du: float = 0.0, dv: float = 0.0) -> Float64Array:
        """(H, W) about 0, shifted so that what was at (u, v) is at (u + du, v + dv)."""
        turn = np.exp(-2j * np.pi * (self._u * du + self._v * dv))
        return np.asarray(np.fft.irfft2(self._waves * turn, self._shape))


def as_image(
    grey: Float64Array, noise: float = 0.0, seed: int = 0, gain: float = 1.0, mean: float = 110.0
) -> Image:
    """(H, W) of grey levels about 0, as an image from a camera with Gaussian noise."""
    sensed = gain * (grey + mean)
    if noise:
        sensed = sensed + np.random.default_rng(seed).normal(0, noise, grey.shape)
    return np.clip(np.rint(sensed), 0, 255).astype(np.uint8)


def pixel_grid(width: int, height: int, step: int, margin: int) -> np.ndarray:
    """(N, 2) float32 pixels, spread evenly over an image, at least ``margin`` from its edge."""
    u, v = np.meshgrid(
        np.arange(margin, width - margin, step), np.arange(margin, height - margin, step)
    )
    return np.stack([u, v], axis=-1).reshape(-1, 2).astype(np.float32)


def points_in_view(
    camera: StereoCamera, count: int, rng: np.random.Generator, near: float, far: float
) -> Float64Array:
    """(N, 3) metres, camera frame: all over the image, with uniformly distributed disparities."""
    px = rng.uniform((8, 8), (camera.width - 9, camera.height - 9), (count, 2))
    fb = camera.fx * camera.baseline
    return camera.triangulate(px, rng.uniform(fb / far, fb / near, count))


def place_information(camera: StereoCamera, place: Float64Array, sigma_px: float) -> Float64Array:
    """(N, 3, 3) 1/m^2 of places (N, 3), camera frame, with equal noise in u, v and disparity."""
    J = projection_jacobian(camera, place) / sigma_px
    return np.asarray(np.swapaxes(J, 1, 2) @ J)


def noisy_place(
    camera: StereoCamera, place: Float64Array, sigma_px: float, rng: np.random.Generator
) -> Float64Array:
    """(N, 3) as triangulated from noisy pixels and disparities of places (N, 3)."""
    px, disparity = camera.project(place)
    px = px + rng.normal(0, sigma_px, px.shape)
    return camera.triangulate(px, disparity + rng.normal(0, sigma_px, disparity.shape))


def watched(
    camera: StereoCamera,
    place: Float64Array,
    velocity: Float64Array,
    rng: np.random.Generator,
    *,
    sigma_px: float = 0.1,
    frames: int = 8,
    dt: float = 1 / 15,
    memory_s: float = 0.5,
    step_std: Float64Array | None = None,
) -> TrackedPoints:
    """Points (N, 3) with velocities (N, 3) m/s, seen over several frames by a camera at rest.

    ``place`` is where they are in the last frame.

    Args:
        step_std: (6,) rad, m: error added to the camera's estimated pose in each frame, which
            displaces all points together.
    """
    belief = Pose.identity()
    sums = None
    for back in range(frames - 1, -1, -1):
        now = place - velocity * (back * dt)
        if step_std is not None and back < frames - 1:
            error = rng.normal(0, step_std)
            belief = Pose.from_rotvec(error[:3], error[3:]) @ belief
        seen = belief.apply(noisy_place(camera, now, sigma_px, rng))
        information = place_information(camera, now, sigma_px)
        if sums is None:
            sums = PositionVelocityFilter.begin(seen, information)
        else:
            sums = sums.advanced(dt, memory_s).with_sightings(seen, information)
    assert sums is not None
    px, disparity = camera.project(place)
    right = px - np.stack([disparity, np.zeros_like(disparity)], axis=1)
    count = len(place)
    points = TrackedPoints.begin(
        0, px.astype(np.float32), right.astype(np.float32), disparity, sums
    )
    return points.but(
        sightings=np.full(count, frames, np.int64), age=np.full(count, (frames - 1) * dt)
    )


def an_obstacle(**changes: Any) -> Obstacle:
    """A confirmed obstacle at 3 m that moves at 0.5 m/s, all else unknown; ``changes`` override."""
    values: dict[str, Any] = {
        "id": 1, "state": TrackState.CONFIRMED, "motion": MotionState.MOVING,
        "position_camera": np.array([0.0, 0.0, 3.0]), "velocity_camera": np.zeros(3),
        "position": None, "velocity": None, "position_cov": None, "velocity_cov": None,
        "velocity_time": 0.5, "speed": 0.5, "speed_std": None,
        "size": np.ones(3), "orientation_wxyz": None, "closing_speed": None,
        "points": 5, "significance": 6.0, "box_px": (0.0, 0.0, 1.0, 1.0), "reason": "it moves",
    }  # fmt: skip
    return Obstacle(**{**values, **changes})


def projection_jacobian(camera: StereoCamera, points: np.ndarray) -> np.ndarray:
    """Derivative (..., 3, 3) of u, v and disparity by camera-frame points (..., 3), px/m.

    NaN for points that do not lie in front of the camera.
    """
    p = np.asarray(points, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        w = np.where(p[..., 2] > 0, 1 / p[..., 2], np.nan)
    J = np.zeros((*p.shape[:-1], 3, 3))
    J[..., 0, 0] = camera.fx * w
    J[..., 0, 2] = -camera.fx * p[..., 0] * w * w
    J[..., 1, 1] = camera.fy * w
    J[..., 1, 2] = -camera.fy * p[..., 1] * w * w
    J[..., 2, 2] = -camera.fx * camera.baseline * w * w
    return J
