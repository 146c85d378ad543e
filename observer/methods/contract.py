"""Interface of the methods that find moving obstacles, in the image plane or in space."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol

from observer.geometry import Pose
from observer.parameters import Parameters
from observer.trace import Trace
from observer.types import EgoMotion, Obstacle, Unseen
from observer.vision.view import StereoRows, View

# Times a stage by name: ``with timer("features"): ...``.
StageTimer = Callable[[str], AbstractContextManager[None]]
# A model of the camera's motion that explains less than this share of the points may have locked
# onto an obstacle.
WEAK_SHARE = 0.4


@dataclass(frozen=True, eq=False)
class Step:
    """Result of a method between an earlier frame and this one.

    Attributes:
        ego: the camera's own motion, with status and reasons.
        T_world_camera: the camera's pose now; None while it is unknown.
        obstacles: all tracks, tentative ones included.
        stereo_share: share of the features whose depth is known.
        rows: None where the method does not match points between left and right.
        unseen: where motion would go unnoticed; None where the method does not report this.
        waiting: the pose is unknown because the method has not seen enough yet; nothing is lost.
        notes: remarks on this frame beyond the reasons why it is weak, one sentence each.
    """

    ego: EgoMotion
    T_world_camera: Pose | None
    obstacles: tuple[Obstacle, ...]
    stereo_share: float
    rows: StereoRows | None
    unseen: Unseen | None = None
    waiting: bool = False
    notes: tuple[str, ...] = ()


class Method(Protocol):
    """Holds the state kept from frame to frame within one segment.

    A method is created with the first view of a segment; that camera pose is the world's origin.
    """

    def step(self, view: View, parameters: Parameters, timer: StageTimer, trace: Trace) -> Step:
        """Compare this view with an earlier one. Views whose pose is unknown are not kept."""
        ...
