"""Whether points leave their epipolar line or seem below the ground, and how significantly."""

from __future__ import annotations

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.geometry import Pose
from observer.methods.monocular.ground import GroundPlane
from observer.methods.monocular.inverse_depth import lines_of_sight, updated
from observer.methods.monocular.motion_test import RayEvidence, ray_evidence
from observer.methods.monocular.rays import RayPoints
from observer.mount import CameraMount
from observer.parameters import EvidenceParameters

CAMERA = StereoCamera(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)
DT = 1 / 15
STEPS = 8
CERTAIN = 1e-14 * np.eye(6)


def evidence(
    place: np.ndarray,
    step: tuple[float, float, float],
    noise_scale: float,
    ground: GroundPlane | None = None,
) -> RayEvidence:
    """Evidence about points (N, 3) that move by ``step`` per frame; the camera moves sideways."""
    px = CAMERA.project(place)[0].astype(np.float32)
    count = len(px)
    ray = lines_of_sight(px, Pose.identity(), CAMERA)
    points = RayPoints.begin(px, np.zeros(3), ray, np.full(count, 0.4), np.full(count, 0.36))
    points = points.but(sigma_px=np.full(count, 0.1))
    for k in range(1, STEPS + 1):
        T = Pose(np.eye(3), np.array([-0.02 * k, 0.0, 0.0]))
        seen = CAMERA.project(T.apply(place + k * np.array(step)))[0].astype(np.float32)
        points = points.but(
            px=seen, before_px=points.px, anchor_s=points.anchor_s + DT,
            sightings=points.sightings + 1,
        )  # fmt: skip
        points = updated(points, T, CERTAIN, noise_scale, CAMERA)
    return ray_evidence(points, T, CERTAIN, DT, ground, 0.0, CAMERA, EvidenceParameters())


def test_twice_the_noise_halves_the_significance_of_leaving_the_epipolar_line() -> None:
    falling = np.array([[0.0, 0.0, 4.0]])
    one, two = (evidence(falling, (0.0, 0.002, 0.0), scale) for scale in (1.0, 2.0))
    assert one.significance[0] > 4
    assert two.significance[0] == pytest.approx(one.significance[0] / 2, rel=0.02)


def test_twice_the_noise_halves_the_significance_of_being_below_the_ground() -> None:
    """A point on the ground that keeps pace with the camera seems to lie far beyond it."""
    ground = GroundPlane.below(CameraMount(0.4, 0.0))
    beside = np.array([[0.0, 0.4, 2.5]])
    one, two = (evidence(beside, (0.015, 0.0, 0.0), scale, ground) for scale in (1.0, 2.0))
    assert one.significance[0] > 4
    assert two.significance[0] == pytest.approx(one.significance[0] / 2, rel=0.1)
