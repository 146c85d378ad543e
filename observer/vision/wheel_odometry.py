"""Motion of the camera by what the wheels have summed up."""

from __future__ import annotations

import numpy as np

from observer.geometry import Pose
from observer.mount import CameraMount
from observer.types import Odometry


def driven_way(before: Odometry | None, now: Odometry | None) -> float | None:
    """Metres between two places by odometry, where both are known."""
    if before is None or now is None:
        return None
    return float(np.hypot(now.x - before.x, now.y - before.y))


def driven_step(before: Odometry, now: Odometry, mount: CameraMount) -> tuple[Pose, float, float]:
    """The camera's motion ``T_now_before`` by the wheels, its length (m) and its turn (rad)."""
    turn = now.yaw - before.yaw
    c, s = np.cos(before.yaw), np.sin(before.yaw)
    dx, dy = now.x - before.x, now.y - before.y
    T_before_now = Pose.from_rotvec([0, 0, turn], [c * dx + s * dy, c * dy - s * dx, 0.0])
    step = mount.T_base_camera.inverse() @ T_before_now.inverse() @ mount.T_base_camera
    return step, float(np.linalg.norm(step.translation)), abs(turn)
