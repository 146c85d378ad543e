"""Motion pooled over the points of a scene, and a board to watch."""

from __future__ import annotations

import numpy as np

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.methods.rigid.camera_step import CameraStep
from observer.methods.rigid.motion_test import pooled_motion
from observer.methods.rigid.point_motion import PooledMotion
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.parameters import EvidenceParameters
from observer.vision.camera_rate import CameraRate

from ...builders import LAB

P = EvidenceParameters()
DT = 1 / 15
STILL = np.zeros((6, 6))
HERE = Pose.identity()

# Rad and metres: typical frame-to-frame uncertainty of a pose.
STEP_STD = np.array([2e-4, 2e-4, 2e-4, 1e-3, 1e-3, 1e-3])


def pooled(
    points: TrackedPoints,
    *,
    camera: StereoCamera = LAB,
    step_covariance: Float64Array = STILL,
    dt: float = DT,
    parameters: EvidenceParameters = P,
    pose: Pose = HERE,
    rate: CameraRate | None = None,
) -> PooledMotion:
    now = CameraStep(camera, pose, step_covariance, rate or CameraRate.still(), dt)
    return pooled_motion(points, now, parameters)


def board(
    rng: np.random.Generator,
    depth: float = 3.0,
    side_px: float = 60.0,
    count: int = 16,
    centre_px: tuple[float, float] = (256.0, 128.0),
    camera: StereoCamera = LAB,
) -> Float64Array:
    """(N, 3) points of a flat board that faces the camera, ``side_px`` pixels wide and high."""
    px = np.array(centre_px) + rng.uniform(-side_px / 2, side_px / 2, (count, 2))
    return camera.triangulate(px, np.full(count, camera.fx * camera.baseline / depth))
