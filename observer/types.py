"""Data passed from stage to stage: frozen, checked on entry, with its validity.

An unknown value is ``None`` with a status, never a zero or an identity.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array, Pose
from observer.intervals import half_95

Image = NDArray[np.uint8]
# u0 v0 u1 v1 in the rectified left image; pixel centres have integer coordinates.
BoxPx = tuple[float, float, float, float]


@dataclass(frozen=True)
class Odometry:
    """Pose of the robot by wheel odometry, accumulated since its start; it drifts.

    Attributes:
        x, y: metres, position of the robot's base in the plane it drives on; x forward and y left
            at its start. yaw: radians, positive to the left.

    Raises:
        ValueError: a number is not finite.
    """

    x: float
    y: float
    yaw: float

    def __post_init__(self) -> None:
        if not np.isfinite([self.x, self.y, self.yaw]).all():
            raise ValueError("odometry must be finite")


@dataclass(frozen=True, eq=False)
class StereoFrame:
    """One pair of images as a source delivered it, without ground truth.

    Attributes:
        index: number of the frame within its source, counted from 0; gaps are dropped frames.
        time: exposure of the left image on the source's own clock, seconds.
        left, right: (H, W) grey or (H, W, 3) BGR uint8, equal sizes, not yet rectified.
        received: the host's monotonic clock at reception, seconds; for age and latency only.
        right_time: exposure of the right image, seconds; None: the same as the left one.
        odometry: wheel odometry at ``time``; None if there is none.

    Raises:
        ValueError: the images differ in size, are empty or not 8 bit, or a time is not finite.
    """

    index: int
    time: float
    left: Image
    right: Image
    received: float
    right_time: float | None = None
    odometry: Odometry | None = None

    def __post_init__(self) -> None:
        for name in ("left", "right"):
            image = getattr(self, name)
            if image.dtype != np.uint8 or image.ndim not in (2, 3) or image.size == 0:
                raise ValueError(f"the {name} image must be 8 bit, grey or BGR, and not empty")
            if image.ndim == 3 and image.shape[2] != 3:
                raise ValueError(f"the {name} image must have 3 channels (BGR) or be grey")
        if self.left.shape[:2] != self.right.shape[:2]:
            raise ValueError(
                "left and right must have the same size, not "
                f"{self.left.shape[1]}x{self.left.shape[0]} and "
                f"{self.right.shape[1]}x{self.right.shape[0]}"
            )
        if not (np.isfinite(self.time) and np.isfinite(self.received)):
            raise ValueError("the times of a frame must be finite")

    def __repr__(self) -> str:
        height, width = self.left.shape[:2]
        return f"<frame {self.index} at {self.time:.3f} s, {width}x{height}>"


class Status(StrEnum):
    """Degree to which a result may be trusted."""

    OK = "ok"
    DEGRADED = "degraded"
    LOST = "lost"


@dataclass(frozen=True, eq=False)
class Matches:
    """The same N scene points seen at t (previous) and t+dt (current), left rectified image.

    Attributes:
        previous: (N, 2) float32 pixels at t.
        current: (N, 2) float32 pixels at t+dt.
    """

    previous: NDArray[np.float32]
    current: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.previous)


class EgoMotion(Protocol):
    """The camera's own motion between t and t+dt, whatever its model.

    ``predict`` returns where a *static* point seen at t must appear at t+dt; observed minus
    predicted position is the residual motion.
    """

    @property
    def status(self) -> Status: ...

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons why the status is not ``ok``, one sentence each."""
        ...

    @property
    def inliers(self) -> NDArray[np.bool_]:
        """Mask (N,) of the matches that follow the model: the static background."""
        ...

    @property
    def covariance(self) -> Float64Array | None:
        """Covariance (P, P) of the model's parameters; None where it is not estimated."""
        ...

    @property
    def homography(self) -> Float64Array | None:
        """Pixel map (3, 3) from t to t+dt of a planar model, by which images are warped.

        None for models that warp no image and while the motion is lost.
        """
        ...

    @property
    def T_current_previous(self) -> Pose | None:
        """The camera's motion if the model provides it, otherwise None."""
        ...

    @property
    def pose_covariance(self) -> Float64Array | None:
        """Covariance (6, 6) of ``T_current_previous``: rotation vector (rad), translation (m)."""
        ...

    def predict(self, px: Float64Array, disparity: Float64Array | None) -> Float64Array:
        """Predict pixels (N, 2) at t+dt of static points seen at pixels (N, 2) at t.

        ``disparity`` (N,) at t is needed by models that account for depth.
        """
        ...


class TrackState(StrEnum):
    """Stage in the life of a track."""

    TENTATIVE = "tentative"
    CONFIRMED = "confirmed"
    COASTING = "coasting"


class MotionState(StrEnum):
    """Current motion of a dynamic obstacle.

    An obstacle that moves in place, such as a waving person, does not travel: its velocity is that
    of its trunk.
    """

    MOVING = "moving"
    IN_PLACE = "in_place"
    STOPPED = "stopped"


@dataclass(frozen=True, eq=False)
class Obstacle:
    """One dynamic obstacle at one frame.

    World quantities are None if the camera's pose is unknown; those relative to the camera are
    always given.

    Attributes:
        id: the track's number, not used again by its observer: negative and provisional while it is
            tentative, positive and permanent from its confirmation on.
        position_camera: (3,) metres, camera frame at this frame: the centre as far as it is known.
        velocity_camera: (3,) m/s, the obstacle's velocity over ground, in camera axes.
        position: (3,) metres, world. velocity: (3,) m/s, world.
        position_cov, velocity_cov: (3, 3) m^2 and (m/s)^2 in world axes, or None if unknown.
        velocity_time: the instant to which the velocity refers, source clock, seconds.
        speed: m/s, magnitude of the velocity. speed_std: standard deviation, m/s, or None.
        size: (3,) metres, extent along the box's own axes. orientation_wxyz: the box's orientation
            in the world; None if the pose is unknown.
        closing_speed: m/s, positive while the range decreases; None if the camera's own
            velocity is unknown.
        points: number of dynamic feature points that support it in this frame.
        significance: significance of the motion, in standard deviations of the residual above zero.
        box_px: u0, v0, u1, v1 in the rectified left image of this frame.
        reason: one sentence: why this counts as dynamic.
        silhouette: closed polygons, each (N, 2) whole pixels of the rectified left image, around
            its visible part in this frame; None if it is not seen or known only by points.
    """

    id: int
    state: TrackState
    motion: MotionState
    position_camera: Float64Array
    velocity_camera: Float64Array
    position: Float64Array | None
    velocity: Float64Array | None
    position_cov: Float64Array | None
    velocity_cov: Float64Array | None
    velocity_time: float
    speed: float
    speed_std: float | None
    size: Float64Array
    orientation_wxyz: Float64Array | None
    closing_speed: float | None
    points: int
    significance: float
    box_px: BoxPx
    reason: str
    silhouette: tuple[Float64Array, ...] | None = None

    def __repr__(self) -> str:
        std = "" if self.speed_std is None else f" ± {half_95(self.speed_std):.2f}"
        return (
            f"<obstacle {self.id}, {self.state}, {self.motion}, {self.speed:.2f}{std} m/s, "
            f"{self.range:.2f} m away>"
        )

    @property
    def range(self) -> float:
        """Distance from the camera, metres."""
        return float(np.linalg.norm(self.position_camera))

    @property
    def bearing(self) -> float:
        """Angle to the right of the optical axis in the camera's x-z plane, radians."""
        return float(np.arctan2(self.position_camera[0], self.position_camera[2]))


# Why motion would go unnoticed in a cell, in words.
UNSEEN_BECAUSE = {
    "plain": "too little texture",
    "dark": "too dark or saturated",
    "near": "too close",
    "fast": "too fast",
    "unmatched": "no match between left and right",
    "tentative": "something may have started to move; not confirmed yet",
}
# Smaller shares of the view are not mentioned.
_REPORTED_SHARE = 0.005


@dataclass(frozen=True)
class Unseen:
    """Regions of the rectified left image in which motion would go unnoticed.

    Attributes:
        share: of the image, without tentative cells. causes: shares by cause, largest first:
            ``plain`` (no texture), ``dark`` (too dark or saturated for an outline to stand out),
            ``near`` (nearer than the stereo search range), ``fast`` (the camera moves too fast for
            dense depth), ``unmatched`` (textured, but left and right do not match), ``tentative``
            (on a body that may have begun to move).
        cell_px: side of a cell, pixels.
        rows: of cells, from the top; in each row one letter per cell, from the left: the first
            letter of its cause, "." where motion would be noticed.
        hides_person: whether a person could move in these regions without being noticed.
    """

    share: float
    causes: Mapping[str, float]
    cell_px: int
    rows: tuple[str, ...]
    hides_person: bool

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons why this degrades a frame, one sentence each; empty if it does not."""
        reasons = []
        if self.hides_person:
            causes = ", ".join(
                f"{UNSEEN_BECAUSE[cause]} ({100 * share:.0f} %)"
                for cause, share in self.causes.items()
                if share >= _REPORTED_SHARE and cause != "tentative"
            )
            reasons.append(
                f"motion could not be detected in {100 * self.share:.0f} % of the view, "
                f"including an area large enough to hide a person: {causes}"
            )
        if "tentative" in self.causes:
            reasons.append(UNSEEN_BECAUSE["tentative"])
        return tuple(reasons)

    def cause_at(self, px: tuple[float, float]) -> str | None:
        """Return the cause at a pixel u, v of the image; None where motion would be noticed."""
        row = min(max(0, int((px[1] + 0.5) // self.cell_px)), len(self.rows) - 1)
        column = min(max(0, int((px[0] + 0.5) // self.cell_px)), len(self.rows[0]) - 1)
        letter = self.rows[row][column]
        return next((cause for cause in self.causes if cause[0] == letter), None)


@dataclass(frozen=True, eq=False)
class Observation:
    """Result of one call of ``Observer.observe``.

    Attributes:
        frame, time, received: of the observed frame.
        segment: number of the run of frames that share one world frame, counted from 0.
        status, reasons: how reliable the frame is, and what limits it.
        parameters_revision: the revision of the parameters that were used.
        T_world_camera: the camera's pose; None where unknown.
        obstacles: all tracks, tentative ones included.
        unseen: where motion could not be detected; None if the method does not report it.
        timings_ms: wall time of each stage, milliseconds; diagnostics, never part of a result.
    """

    frame: int
    time: float
    received: float
    segment: int
    status: Status
    reasons: tuple[str, ...]
    parameters_revision: int
    T_world_camera: Pose | None
    obstacles: tuple[Obstacle, ...]
    timings_ms: Mapping[str, float] = field(default_factory=dict)
    unseen: Unseen | None = None

    def __repr__(self) -> str:
        return (
            f"<observation of frame {self.frame} at {self.time:.3f} s, {self.status}, "
            f"{len(self.reported)} obstacles>"
        )

    @property
    def reported(self) -> tuple[Obstacle, ...]:
        """The obstacles that are shown and written by default: confirmed and coasting ones."""
        return tuple(o for o in self.obstacles if o.state is not TrackState.TENTATIVE)
