"""A run's cameras in the terms that Foxglove and ROS share: frames, distortion, projection.

Frames: ``level`` (z up, the ground at z = 0 where the mount is known) is the parent of ``world``
(that of the observations), which is the parent of ``camera`` (the rectified left camera), which is
the parent of ``base`` (the robot) and of ``camera_left`` and ``camera_right`` (the cameras as
taken, before rectification). ``odom`` is the origin of the robot's wheel odometry.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from observer.camera import StereoCalibration
from observer.geometry import Float64Array, Pose
from observer.mount import CameraMount, level_pose
from observer.vision.rectification import Rectification

DistortionModel = Literal["plumb_bob", "rational_polynomial", "equidistant"]
# REP-104 and Foxglove expect this many for plumb_bob.
_LEAST_COEFFICIENTS = 5


@dataclass(frozen=True, eq=False)
class CameraModel:
    """A camera for its images as taken, as in ROS's ``CameraInfo`` (REP-104).

    Attributes:
        K: (3, 3) pixels. D: (N,) distortion of the model, in OpenCV's order.
        R: (3, 3) rectification. P: (3, 4) projection of the rectified image, in pixels and, for
            the right camera, pixel metres.
    """

    model: DistortionModel
    K: Float64Array
    D: Float64Array
    R: Float64Array
    P: Float64Array


def camera_model(
    calibration: StereoCalibration, rectified: Rectification, side: Literal["left", "right"]
) -> CameraModel:
    """Return the model of one camera."""
    left = side == "left"
    K, D = (calibration.K1, calibration.D1) if left else (calibration.K2, calibration.D2)
    camera = rectified.camera
    P = np.zeros((3, 4))
    P[:, :3] = camera.K
    P[0, 3] = 0.0 if left else -camera.fb
    model: DistortionModel = "equidistant"
    if calibration.distortion_model != "equidistant":
        model = "plumb_bob" if D.size <= _LEAST_COEFFICIENTS else "rational_polynomial"
        D = np.concatenate([D, np.zeros(max(0, _LEAST_COEFFICIENTS - D.size))])
    R = rectified.R_rectified_left if left else rectified.R_rectified_right
    return CameraModel(model, K, D, R, P)


def fixed_frames(
    rectified: Rectification, mount: CameraMount | None
) -> list[tuple[str, str, Pose]]:
    """Return (parent, child, ``T_parent_child``) of the transforms that are fixed in a segment."""
    # Rectification rotates each camera about its own centre.
    right = np.array([rectified.camera.baseline, 0.0, 0.0])
    frames = [
        ("level", "world", level_pose(mount)),
        ("camera", "camera_left", Pose(rectified.R_rectified_left, np.zeros(3))),
        ("camera", "camera_right", Pose(rectified.R_rectified_right, right)),
    ]
    if mount is not None:
        frames.append(("camera", "base", mount.T_base_camera.inverse()))
    return frames
