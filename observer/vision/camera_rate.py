"""Motion of the camera per second, and the velocity errors that miscalibration causes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.kernels.lasting_errors import lasting_errors


@dataclass(frozen=True, eq=False)
class CameraRate:
    """The camera's motion per second: a static point p, camera frame, moves at turn x p + shift.

    Attributes:
        turn: (3,) rad/s. shift: (3,) m/s.
    """

    turn: Float64Array
    shift: Float64Array

    @staticmethod
    def still() -> CameraRate:
        """Rate of a camera that does not move."""
        return CameraRate(np.zeros(3), np.zeros(3))

    @staticmethod
    def of(T_current_previous: Pose, dt: float) -> CameraRate:
        """Return the rate of a motion over ``dt`` seconds."""
        return CameraRate(T_current_previous.rotvec / dt, T_current_previous.translation / dt)

    def over(self, dt: float) -> Pose:
        """T_later_now: the motion over ``dt`` seconds, which may be negative."""
        return Pose.from_rotvec(self.turn * dt, self.shift * dt)

    def static_flow(
        self,
        px: Float64Array | NDArray[np.float32],
        disparity: Float64Array,
        camera: StereoCamera,
    ) -> Float64Array:
        """(N, 2) px/s: how static points move in the left image, f d/dt (x / z) and f d/dt (y / z).

        Args:
            px: (N, 2) and disparity: (N,) px, where they are seen.
        """
        place = camera.triangulate(px, disparity)
        velocity, depth = np.cross(self.turn, place) + self.shift, place[:, 2:]
        across = velocity[:, :2] - place[:, :2] / depth * velocity[:, 2:]
        return np.asarray(np.array([camera.fx, camera.fy]) * across / depth, np.float64)

    def velocity_by_bias(
        self, place: Float64Array, velocity: Float64Array, camera: StereoCamera
    ) -> Float64Array:
        """(N, 3) m/s per pixel, camera axes: apparent velocity from a constant disparity error.

        A disparity d that is wrong by b puts the point p to p - p b/d. As the camera drives, d
        changes and with it the error: it moves at -b/d (p' + p Z'/Z), where p' is the point's
        velocity relative to the camera and Z' the rate of its depth (the derivative of p b/d, with
        d = f B / Z). Unlike noise, this error is not reduced by more sightings.

        Args:
            place: (N, 3) metres, camera frame. velocity: (N, 3) m/s, the points' own, camera axes.
        """
        return self._drifts(place, velocity, camera)[:, 0]

    def lasting_errors(
        self,
        place: Float64Array,
        velocity: Float64Array,
        camera: StereoCamera,
        bias_px: float,
        distortion_sigma: float,
    ) -> Float64Array:
        """(N, 2, 3) m/s, camera axes: one-sigma errors from the disparity and from distortion.

        Where residual distortion stretches the image too much, everything passing there seems too
        fast by the same share. That share is ``distortion_sigma`` in the image's corners and falls
        towards the principal point with the fourth power of the distance: so does distortion, and
        the calibration is worst near the edges, where the board was rarely seen.

        Args:
            place, velocity: as of ``velocity_by_bias``.
            bias_px, distortion_sigma: one standard deviation each, as ``disparity_bias_px`` and
                ``distortion_sigma`` of ``EvidenceParameters``.
        """
        each = np.array([[bias_px], [distortion_sigma]])
        return np.asarray(self._drifts(place, velocity, camera) * each, np.float64)

    def _drifts(
        self, place: Float64Array, velocity: Float64Array, camera: StereoCamera
    ) -> Float64Array:
        """(N, 2, 3) m/s, camera axes: per pixel of disparity, and per unit distortion."""
        return lasting_errors(
            np.ascontiguousarray(place), np.ascontiguousarray(velocity), self.turn, self.shift,
            camera.numbers, camera.corner_px**2,
        )  # fmt: skip
