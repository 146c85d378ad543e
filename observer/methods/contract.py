"""What a method of finding moving obstacles is: the paper's planar one, or motion in space."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array, Pose
from observer.parameters import Parameters
from observer.types import EgoMotion, Image, Obstacle, Odometry, StereoFrame, Trace

# Times a stage by name: ``with timer("features"): ...``.
StageTimer = Callable[[str], AbstractContextManager[None]]


@dataclass(frozen=True, eq=False)
class View:
    """A rectified pair in grey, as the methods work on it.

    Attributes:
        index: number of the frame. time: exposure of the left image, seconds, source clock.
        right_time: exposure of the right one, seconds; None where it is that of the left.
        left, right: (H, W). odometry: of the robot's wheels; None unknown.
    """

    index: int
    time: float
    right_time: float | None
    left: Image
    right: Image
    odometry: Odometry | None = None

    @staticmethod
    def of(frame: StereoFrame, left: Image, right: Image) -> View:
        """The view of a frame whose rectified images in grey are these."""
        return View(frame.index, frame.time, frame.right_time, left, right, frame.odometry)


@dataclass(frozen=True, eq=False)
class StereoRows:
    """Where N points of the left image were found in the right one, to check the calibration.

    Attributes:
        px: (N, 2) pixels, left image. offset_px: (N,) left minus right row, pixels.
        disparity: (N,) pixels at the left image's exposure; NaN unknown.
        number: (N,) each point's own number, never used twice in a segment.
    """

    px: Float64Array
    offset_px: Float64Array
    disparity: Float64Array
    number: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Step:
    """What a method found between an earlier frame and this one.

    Attributes:
        ego: the camera's own motion, with status and reasons.
        T_world_camera: the camera's pose now; None while it is unknown.
        obstacles: all tracks, tentative ones included.
        stereo_share: share of the features whose depth is known.
        rows: None where the method does not match points between left and right.
        waiting: the pose is unknown because the method has not seen enough yet; nothing is lost.
    """

    ego: EgoMotion
    T_world_camera: Pose | None
    obstacles: tuple[Obstacle, ...]
    stereo_share: float
    rows: StereoRows | None
    waiting: bool = False


class Method(Protocol):
    """Holds what must be remembered from frame to frame within one segment."""

    def begin(self, view: View, parameters: Parameters) -> None:
        """Forget everything; this view is the first of a new world."""
        ...

    def step(self, view: View, parameters: Parameters, timer: StageTimer, trace: Trace) -> Step:
        """Compare this view with an earlier one. A view whose pose is unknown is not kept."""
        ...
