"""Motion of the camera from wheel odometry."""

from __future__ import annotations

import numpy as np

from observer.geometry import Pose
from observer.mount import CameraMount
from observer.types import Odometry

# Wheels and images may differ by this share of the motion plus these rates, rad/s and m/s.
_SHARE_OFF, _TURN_RATE_OFF, _SPEED_OFF = 0.15, 0.1, 0.15


def driven_distance(before: Odometry | None, now: Odometry | None) -> float | None:
    """Return the metres between two places by odometry; None unless both are known."""
    if before is None or now is None:
        return None
    return float(np.hypot(now.x - before.x, now.y - before.y))


def driven_step(before: Odometry, now: Odometry, mount: CameraMount) -> tuple[Pose, float, float]:
    """Return the camera's motion ``T_now_before`` by odometry, its length (m) and turn (rad)."""
    turn = now.yaw - before.yaw
    c, s = np.cos(before.yaw), np.sin(before.yaw)
    dx, dy = now.x - before.x, now.y - before.y
    T_before_now = Pose.from_rotvec([0, 0, turn], [c * dx + s * dy, c * dy - s * dx, 0.0])
    step = mount.T_base_camera.inverse() @ T_before_now.inverse() @ mount.T_base_camera
    return step, float(np.linalg.norm(step.translation)), abs(turn)


def agrees(
    T_now_before: Pose, before: Odometry | None, now: Odometry | None, mount: CameraMount, dt: float
) -> bool:
    """Return whether odometry agrees with a camera motion over a step of ``dt`` seconds.

    False if one of the two places is unknown. The bounds allow for wheel slip, for the delay
    between frame and odometry packet, and for a mount measured by hand, but not for a walking
    person mistaken for the background.
    """
    if before is None or now is None:
        return False
    by_wheels, driven_m, turn = driven_step(before, now, mount)
    off = by_wheels @ T_now_before.inverse()
    turned = float(np.linalg.norm(off.rotvec))
    moved = float(np.linalg.norm(off.translation))
    lever = mount.lever_sigma_m * turn
    return turned <= _TURN_RATE_OFF * dt + _SHARE_OFF * turn and (
        moved <= _SPEED_OFF * dt + _SHARE_OFF * driven_m + lever
    )
