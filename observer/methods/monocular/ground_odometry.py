"""The ground as an odometer: the camera's translation in metres where there are no wheel data.

The mount gives the camera's pose above the ground; ``ground_alignment`` measures the motion since
a mark, a reference image of the ground that is used until enough has been driven for the next.
"""

from __future__ import annotations

import numpy as np

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.methods.monocular.ground import GroundPlane
from observer.methods.monocular.ground_alignment import DISTANCE_SHARED, GroundMark, GroundMotion
from observer.types import Image

# Radians, one standard deviation: rotation of the map's poses, and the rotation that best explains
# the points of the first views, which mistakes some translation for rotation.
_MAP_TURN_SIGMA, _FIRST_TURN_SIGMA = 0.003, 0.01
# Share, one standard deviation: scale of a map from points alone.
_MAP_SCALE_SIGMA = 0.1
# Parallax of points that is more than noise, radians.
_LEAST_PARALLAX = 0.0005
# Weight of the newest step in the predicted one; smooths its noise.
_STEP_GAIN = 0.3
# Metres, least standard deviation of a motion measured from the ground; and standard deviations:
# if it differs by more from the points' motion, it is not the ground.
_LEAST_DISTANCE_SIGMA_M, _AGREEING_SIGMAS = 0.001, 4.0
# After this translation, metres, or rotation, radians, much of the mark's ground is out of sight.
_LEAST_DISTANCE_M, _TURNED_RAD = 0.12, 0.15


class GroundFollower:
    """Tracks the ground from a first view on, before anything else is known of the motion."""

    def __init__(self, image: Image, ground: GroundPlane, camera: StereoCamera) -> None:
        """``ground`` is the plane in the axes of the camera that took ``image`` (H, W), grey."""
        self._mark = GroundMark(image, ground, camera)
        self._place = self._step = np.zeros(3)

    def followed(
        self, image: Image, R_now_first: Float64Array, parallax: float
    ) -> GroundMotion | None:
        """Return the motion since the first view; None where the ground does not show it.

        Args:
            image: (H, W) grey, now. R_now_first: (3, 3) rotation that best explains the points.
            parallax: radians, of the points beyond that rotation; zero means no translation.
        """
        if parallax < _LEAST_PARALLAX:
            return None
        ahead = self._place + self._step
        seen = self._mark.aligned(image, Pose(R_now_first, ahead), _FIRST_TURN_SIGMA)
        # If the ground is not seen now, extrapolate; it may be seen again in a later image.
        now = ahead if seen is None else seen.T_now_mark.translation
        self._step = self._step + _STEP_GAIN * (now - self._place - self._step)
        self._place = now
        return seen


class GroundOdometer:
    """Measures the camera's motion over the ground, from mark to mark."""

    def __init__(
        self, image: Image, T_camera_world: Pose, ground: GroundPlane, camera: StereoCamera
    ) -> None:
        """``ground`` is the plane in the camera's axes, wherever a mark is made."""
        self._ground = ground
        self._camera = camera
        self._mark = GroundMark(image, ground, camera)
        self._T_mark = T_camera_world
        self._seen: GroundMotion | None = None

    @property
    def sees(self) -> bool:
        """Return whether the ground showed the camera's motion in the last image."""
        return self._seen is not None

    def measured(
        self, image: Image, T_camera_world: Pose, covariance: Float64Array
    ) -> tuple[Pose, Float64Array] | None:
        """Return the camera's pose from the ground, and its information (6, 6).

        None where the ground does not show it or contradicts the points.

        Args:
            image: (H, W) grey, now. T_camera_world: the pose from points; covariance: (6, 6) of it.
        """
        self._seen = None
        guess = T_camera_world @ self._T_mark.inverse()
        distance = float(np.linalg.norm(guess.translation))
        seen = self._mark.aligned(image, guess, _MAP_TURN_SIGMA)
        if seen is None:
            return None
        shared = DISTANCE_SHARED * distance + _LEAST_DISTANCE_SIGMA_M
        own = seen.covariance + np.diag([0.0] * 3 + [shared**2] * 3)
        gap = seen.T_now_mark.translation - guess.translation
        doubt = own[3:, 3:] + covariance[3:, 3:] + (_MAP_SCALE_SIGMA * distance) ** 2 * np.eye(3)
        if gap @ np.linalg.solve(doubt, gap) > _AGREEING_SIGMAS**2:
            return None
        self._seen = seen
        return seen.T_now_mark @ self._T_mark, np.asarray(np.linalg.pinv(own), np.float64)

    def compared(self, image: Image, T_camera_world: Pose) -> tuple[float, float] | None:
        """Return the logarithm of ground distance over map distance, and its standard deviation.

        A new mark is made once the camera has moved or turned far enough from the last one. None
        before that, if the distance is too short, and where the ground did not show the motion.
        """
        moved = T_camera_world @ self._T_mark.inverse()
        distance = float(np.linalg.norm(moved.translation))
        if distance < _LEAST_DISTANCE_M and float(np.linalg.norm(moved.rotvec)) < _TURNED_RAD:
            return None
        seen = self._seen
        self._mark = GroundMark(image, self._ground, self._camera)
        self._T_mark = T_camera_world
        if seen is None or distance < _LEAST_DISTANCE_M:
            return None
        return float(np.log(seen.distance_m / distance)), seen.distance_sigma
