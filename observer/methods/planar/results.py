"""Results that one step of the planar method hands to the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.types import BoxPx, TrackState


@dataclass(frozen=True, eq=False)
class ResidualFlow:
    """Motion that remains after the camera's own motion is removed; M features.

    Attributes:
        px: (M, 2) float32 pixels at t.
        observed_px: (M, 2) float32 pixels where the feature is found in the image of t+dt as
            transformed into the frame of t; a static point stays where it was.
        dynamic: (M,) whether the residual exceeds the threshold.
    """

    px: NDArray[np.float32]
    observed_px: NDArray[np.float32]
    dynamic: NDArray[np.bool_]

    @property
    def residual_px(self) -> NDArray[np.float32]:
        """Residual (M, 2), observed minus predicted, pixels."""
        return np.asarray(self.observed_px - self.px, dtype=np.float32)


@dataclass(frozen=True, eq=False)
class PointMotions:
    """K dynamic features whose depth is known at both instants.

    Attributes:
        points_previous, points_current: (K, 3) metres, both in the camera frame of t.
        points_camera: (K, 3) metres, where the points are at t+dt in the camera frame of t+dt.
        px_current: (K, 2) pixels in the rectified left image of t+dt.
        velocity: (K, 3) m/s over ground, axes of the camera frame of t: the displacement over dt.
        velocity_cov: (K, 3, 3) (m/s)^2, of the measurement noise of each point.
        point_cov: (K, 3, 3) m^2, of ``points_camera``.
        model_error: (K, 3) m/s, the false velocity that a static point at this place would show
            because the model of the ego-motion does not fit its depth; NaN where unknown.
        model_error_cov: (K, 3, 3) (m/s)^2, of ``model_error``, from the pose covariance; common
            to all points, so averaging does not reduce it.
        R_current_previous: (3, 3) turns the axes of the camera frame of t into those of t+dt; the
            identity where the turn is unknown.
    """

    points_previous: Float64Array
    points_current: Float64Array
    points_camera: Float64Array
    px_current: Float64Array
    velocity: Float64Array
    velocity_cov: Float64Array
    point_cov: Float64Array
    model_error: Float64Array
    model_error_cov: Float64Array
    R_current_previous: Float64Array


@dataclass(frozen=True, eq=False)
class Detection:
    """One group of dynamic points in one frame, not yet assigned to a track.

    Everything is in the camera frame of this frame (t+dt) and its axes.

    Attributes:
        position: (3,) metres, centre of the points. position_cov: (3, 3) m^2.
        velocity: (3,) m/s over ground. velocity_cov: (3, 3) (m/s)^2, None where the camera's
            pose, and therefore the error of the ego-motion model, is unknown.
        velocity_time: the instant the velocity belongs to, source clock, seconds.
        size: (3,) metres, the points' extent along the camera's axes.
        points: number of points. significance: length of the velocity in standard deviations.
        box_px: u0, v0, u1, v1 in the rectified left image.
    """

    position: Float64Array
    position_cov: Float64Array
    velocity: Float64Array
    velocity_cov: Float64Array | None
    velocity_time: float
    size: Float64Array
    points: int
    significance: float
    box_px: BoxPx

    @property
    def speed(self) -> float:
        """Length of the velocity, m/s."""
        return float(np.linalg.norm(self.velocity))


@dataclass(frozen=True, eq=False)
class Track:
    """One obstacle's identity over time, as it stands at one frame.

    The tracking frame is the world frame. While the camera's pose is unknown, the camera is
    assumed to be at its last known pose, only to keep identities.

    Attributes:
        id: as of ``Obstacle``, unique within an observer once it is confirmed.
        detection: the newest one assigned to it.
        position: (3,) metres, tracking frame, at this frame; extrapolated while coasting.
        velocity: (3,) m/s, tracking frame, of ``detection``: the raw displacement over dt.
        sightings: detections so far. missed: frames since the last one.
    """

    id: int
    state: TrackState
    detection: Detection
    position: Float64Array
    velocity: Float64Array
    sightings: int
    missed: int
