"""Track of one obstacle on the ground, seen by one camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from observer.geometry import Float64Array, mahalanobis
from observer.types import BoxPx, MotionState, TrackState


@dataclass(eq=False)
class GroundTrack:
    """An obstacle that stands or moves on the ground.

    Attributes:
        id: as of ``Obstacle``. state, motion: as reported.
        mean: (4,) place of its foot, m, and velocity, m/s, on the ground; covariance: (4, 4),
            from the pixel noise alone.
        box_px: u0 v0 u1 v1 in the left image; its lower edge is where it touches the ground.
        size: (2,) metres: width and height, from the box at that distance.
        points: tracked points seen on it in this frame. hits: frames in which it moved
            significantly. missed_s, age_s: seconds since it was seen, and since it began.
        significance: Mahalanobis length of the velocity.
        evidence: significance, in standard deviations, of its points' motion when it began.
        floating: whether it was found by its ground contact, not by leaving the epipolar lines.
    """

    id: int
    mean: Float64Array
    covariance: Float64Array
    box_px: BoxPx
    size: Float64Array
    evidence: float
    floating: bool
    state: TrackState = TrackState.TENTATIVE
    motion: MotionState = MotionState.MOVING
    points: int = 0
    hits: int = 0
    missed_s: float = 0.0
    age_s: float = 0.0
    significance: float = 0.0

    @property
    def place(self) -> Float64Array:
        """(2,) metres, ground axes."""
        return self.mean[:2]

    @property
    def velocity(self) -> Float64Array:
        """(2,) m/s, ground axes."""
        return self.mean[2:]

    def predict(self, dt: float, acceleration: float) -> None:
        """Predict ``dt`` seconds ahead with white-noise ``acceleration``, m/s^2."""
        F = np.eye(4)
        F[0, 2] = F[1, 3] = dt
        G = np.array([[dt * dt / 2, 0], [0, dt * dt / 2], [dt, 0], [0, dt]])
        self.mean = F @ self.mean
        self.covariance = F @ self.covariance @ F.T + acceleration**2 * G @ G.T

    def update(self, place: Float64Array, noise: Float64Array) -> None:
        """Update with the place (2,) where its foot is seen, with covariance (2, 2)."""
        S = self.covariance[:2, :2] + noise
        gain = np.linalg.solve(S, self.covariance[:2]).T
        self.mean = self.mean + gain @ (place - self.mean[:2])
        left = np.eye(4)
        left[:, :2] -= gain
        self.covariance = left @ self.covariance @ left.T + gain @ noise @ gain.T

    def length_to(self, place: Float64Array, noise: Float64Array) -> float:
        """Return the Mahalanobis distance from its predicted place to a place (2,)."""
        gap = place - self.mean[:2]
        S = self.covariance[:2, :2] + noise
        return mahalanobis(gap, S)
