"""Static points and obstacles as a camera of known pose sees them, and the estimate of its pose."""

from __future__ import annotations

import dataclasses

import numpy as np

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.methods.rigid.ego_motion import StaticScene, estimate_rigid_motion
from observer.parameters import EgoMotionParameters
from observer.vision.rigid_ego_motion import RigidEgoMotion

from ...builders import LAB, place_information, points_in_view

P = EgoMotionParameters(model="rigid")
SIGMA = 0.12
BEFORE = Pose.from_rotvec((0.05, -0.3, 0.02), (0.4, -0.1, 1.5))
STEP = Pose.from_rotvec((0.004, 0.02, -0.006), (0.012, -0.004, -0.03))
AFTER = STEP @ BEFORE


def seen(
    rng: np.random.Generator,
    count: int = 200,
    *,
    camera: StereoCamera = LAB,
    depths: tuple[float, float] = (1.0, 8.0),
    pose: Pose = AFTER,
    noise: float = 1.0,
    place_noise: float = 1.0,
) -> StaticScene:
    """Points of the world as a camera at the pose sees them, their places and pixels noisy.

    ``noise`` and ``place_noise`` scale the errors relative to their stated deviations.
    """
    place = points_in_view(camera, count, rng, *depths)
    px, disparity = camera.project(place)
    covariance = np.linalg.inv(place_information(camera, place, SIGMA / 2))
    error = np.einsum(
        "nij,nj->ni", np.linalg.cholesky(covariance), rng.normal(0, place_noise, (count, 3))
    )
    T_world_camera = pose.inverse()
    R = T_world_camera.rotation
    return StaticScene(
        position=T_world_camera.apply(place + error),
        covariance=R @ covariance @ R.T,
        px=px + rng.normal(0, noise * SIGMA, px.shape),
        disparity=disparity + rng.normal(0, noise * SIGMA, count),
        sigma=np.full((count, 3), SIGMA),
        weight=np.ones(count),
    )


def exactly_seen(rng: np.random.Generator, count: int = 200, pose: Pose = AFTER) -> StaticScene:
    return seen(rng, count, pose=pose, noise=0.0, place_noise=0.0)


def both(first: StaticScene, second: StaticScene) -> StaticScene:
    return StaticScene(
        *(
            np.concatenate([getattr(first, f.name), getattr(second, f.name)])
            for f in dataclasses.fields(StaticScene)
        )
    )


def but(scene: StaticScene, **changes: Float64Array) -> StaticScene:
    return dataclasses.replace(scene, **changes)


def obstacle(
    rng: np.random.Generator, count: int, moved: tuple[float, float, float]
) -> StaticScene:
    """A textured board at 1.5 m that is displaced, as the camera at ``AFTER`` sees it."""
    place = rng.uniform((-0.3, -0.3, 1.45), (0.3, 0.3, 1.55), (count, 3))
    px, disparity = LAB.project(place + moved)
    covariance = np.linalg.inv(place_information(LAB, place, SIGMA / 2))
    T_world_camera = AFTER.inverse()
    return StaticScene(
        position=T_world_camera.apply(place),
        covariance=T_world_camera.rotation @ covariance @ T_world_camera.rotation.T,
        px=px + rng.normal(0, SIGMA, px.shape),
        disparity=disparity + rng.normal(0, SIGMA, count),
        sigma=np.full((count, 3), SIGMA),
        weight=np.ones(count),
    )


def estimated(
    scene: StaticScene,
    *,
    camera: StereoCamera = LAB,
    expected: Pose = BEFORE,
    parameters: EgoMotionParameters = P,
    seed: int = 1,
) -> RigidEgoMotion:
    return estimate_rigid_motion(scene, BEFORE, expected, camera, parameters, seed)


def error_of(ego: RigidEgoMotion, truth: Pose = AFTER) -> Float64Array:
    """(6,) rotation vector (rad) and translation (m) by which the pose is off, camera axes."""
    assert ego.T_camera_world is not None
    off = ego.T_camera_world @ truth.inverse()
    return np.concatenate([off.rotvec, off.translation])
