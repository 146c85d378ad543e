"""True calibration of the two simulated cameras, from a scenario."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from observer.camera import StereoCalibration
from observer.geometry import Float64Array
from observer.simulation.specs.cameras import CameraSpec, FaultSpec


def true_calibration(camera: CameraSpec, faults: FaultSpec) -> StereoCalibration:
    """Return the true calibration, with lenses and tilt."""
    c = camera
    focal = c.width / 2 / math.tan(math.radians(c.hfov_deg) / 2)
    K = np.array([[focal, 0, (c.width - 1) / 2], [0, focal, (c.height - 1) / 2], [0, 0, 1.0]])
    lens, tilt = faults.lens, faults.tilt
    D = np.array([lens.k1, lens.k2, lens.p1, lens.p2, 0.0])
    R = small_rotation(tilt.pitch_deg, tilt.vergence_deg, tilt.roll_deg)
    centre_right_in_left = np.array([c.baseline_m, 0.0, 0.0])
    return StereoCalibration(c.width, c.height, K, D, K, D, R, -R @ centre_right_in_left)


def small_rotation(pitch_deg: float, yaw_deg: float, roll_deg: float) -> Float64Array:
    """Return the (3, 3) rotation by small angles about a camera's x, y and z axes."""
    if not (pitch_deg or yaw_deg or roll_deg):
        return np.eye(3)
    R = Rotation.from_euler("xyz", [pitch_deg, yaw_deg, roll_deg], degrees=True).as_matrix()
    return np.asarray(R, dtype=np.float64)
