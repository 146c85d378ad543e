"""One obstacle over time: how it moves, how large it is, what is known of its life."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.kernels.body_filter import velocity_at_centre
from observer.kernels.sight import view_of
from observer.methods.rigid.bodies.changes import Changes
from observer.methods.rigid.bodies.filter import (
    POSITION,
    VELOCITY,
    YAW,
    YAW_RATE,
    BodyFilter,
    turning_velocity,
    yaw_matrix,
)
from observer.methods.rigid.bodies.outline import Outline
from observer.methods.rigid.bodies.recent_motion import RecentMotion
from observer.methods.rigid.bodies.shape import BodyShape, Box
from observer.methods.rigid.bodies.steady_drive import SteadyDrive
from observer.types import MotionState, TrackState

# Seconds out of sight after which nothing is known of how a body moves.
_FORGOTTEN_S = 0.4
_NOWHERE = np.zeros(3)
# (m/s)^2: by how much a limb's velocity differs from that of its body.
_LIMB_COV = np.diag([0.5, 0.05, 0.5]) ** 2
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)


@dataclass(eq=False)
class BodyTrack:
    """One obstacle over time.

    Attributes:
        id: as of ``Obstacle``. state, motion: as reported.
        filter: place, velocity, yaw. The place is that of the body's own origin, not its centre.
        recent: how it moved up to now.
        shape: where its points are in its own frame. box: in that frame; None before the first
            update.
        points: members seen in this frame. frames: since it began. missed_s: seconds since it
            was last seen. age_s: seconds since it began. steady_s: since it last manoeuvred.
        hits: frames in which it moved significantly. sightings: of members in those frames,
            beyond those that may err alike.
        significance: Mahalanobis length of the velocity.
        box_px: u0 v0 u1 v1 in the left image, around what is seen of it; while it is not seen,
            where that should be by now.
        lasting_cov: (3, 3) (m/s)^2, world: of the velocity, by errors that time does not reduce.
        outline: at which it stands out in depth; None before one was found.
        rigid: False once its limbs were seen to move by themselves, or before any point is known
            to move along. rigidity: recent share of its points that move along. loosened: points
            that moved as one were taken for it, and may have been those of a limb.
        by_points: its points measured it in this frame.
        drive: for how long points on it have moved steadily as one.
        changes: when something on it looked another than a moment before.
        crosses: its points move across the view as surely as an obstacle's.
        part_moves: it began as the whole person of whom a part was seen to move.
        merged_s: seconds for which it has been seen as no thing of its own, but for one with what
            is around it.
        far: it is seen by points alone, and so far away that they only seem to come or go.
        stood_s: seconds for which it has not moved. unsure_s: for which it may as well stand.
        confirmed_at: (3,) metres, world, where its centre was when it was confirmed as moving; None
            before, and once it was seen to have left that place.
    """

    id: int
    filter: BodyFilter
    shape: BodyShape
    recent: RecentMotion = field(default_factory=RecentMotion)
    state: TrackState = TrackState.TENTATIVE
    motion: MotionState = MotionState.MOVING
    box: Box | None = None
    points: int = 0
    frames: int = 0
    sightings: int = 0
    missed_s: float = 0.0
    age_s: float = 0.0
    steady_s: float = 0.0
    hits: int = 0
    significance: float = 0.0
    box_px: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    lasting_cov: Float64Array = field(default_factory=lambda: np.zeros((3, 3)))
    outline: Outline | None = None
    rigid: bool = True
    rigidity: float = 1.0
    loosened: bool = False
    by_points: bool = False
    drive: SteadyDrive = field(default_factory=SteadyDrive)
    changes: Changes = field(default_factory=Changes)
    crosses: bool = False
    part_moves: bool = False
    merged_s: float = 0.0
    stands: bool = True
    far: bool = False
    stood_s: float = 0.0
    unsure_s: float = 0.0
    confirmed_at: Float64Array | None = None
    # (3,) u, v and disparity of its centre in the last frame, px.
    _centre_px: Float64Array | None = None

    @property
    def mean(self) -> Float64Array:
        """(8,) the filter's state, world."""
        return self.filter.mean

    @property
    def yaw(self) -> float:
        """Radians by which the body has turned since its track began."""
        return float(self.mean[YAW])

    @property
    def yaw_rate(self) -> float:
        """Radians per second, positive to the right."""
        return float(self.mean[YAW_RATE])

    @property
    def R(self) -> Float64Array:
        """(3, 3) from the body's frame to the world's."""
        return self.filter.rotation

    @property
    def centre(self) -> Float64Array:
        """(3,) metres, world: of the box."""
        offset = np.zeros(3) if self.box is None else self.R @ self.box.centre
        return self.mean[POSITION] + offset

    @property
    def seen_outline(self) -> Outline | None:
        """Its outline, if it is seen in this frame."""
        return None if self.outline is None or not self.outline.seen else self.outline

    def centre_velocity(self) -> tuple[Float64Array, Float64Array]:
        """(3,) m/s and its covariance (3, 3), world: of the centre.

        That of a turning body depends on where its centre is, which is not known exactly.
        """
        arm, doubt_m = _NOWHERE, 0.0
        if self.box is not None:
            arm = self.R @ self.box.centre
            width, _, length = self.box.size.tolist()
            doubt_m = self.shape.centre_doubt * max(width, length)
        return velocity_at_centre(self.mean, self.filter.covariance, arm, self.lasting_cov, doubt_m)

    @property
    def forgotten(self) -> bool:
        """True of what was out of sight for so long that it may move in any way."""
        return self.missed_s > _FORGOTTEN_S

    def loosen(self) -> None:
        """Count it as a body with limbs, of whose yaw nothing is known.

        What moved as one until now may have been a limb, which is faster or slower than the body.
        That is not doubted where only legs are in view, for then nothing tells better.
        """
        self.rigid, self.rigidity, self.loosened = False, 0.0, True
        self.filter = self.filter.straightened()
        if self.outline is None or not self.outline.only_legs:
            self.filter = self.filter.doubted(_LIMB_COV)

    def stiffen(self, motion: BodyFilter) -> None:
        """Count it as a rigid body, which moves as points on it were found to."""
        self.rigid, self.rigidity, self.loosened = True, 1.0, False
        self.restart(motion)

    def restart(self, motion: BodyFilter) -> None:
        """Forget how it moved and where points on it were; it keeps its name and its size."""
        if self.outline is not None:
            self.outline.move_origin(motion.mean[POSITION] - self.mean[POSITION])
        self.filter = motion
        self.shape.forget()
        self.recent.forget()

    def carry_box(self, T_camera_world: Pose, camera: StereoCamera) -> None:
        """Move the box of a body that is not seen to where it is expected in this frame."""
        pose, before = T_camera_world, self._centre_px
        now = np.array(view_of(self.centre, pose.rotation, pose.translation, camera.numbers))
        if not np.isfinite(now).all():
            return
        if self.missed_s > 0 and before is not None:
            corners = np.array(self.box_px).reshape(2, 2) - before[:2]
            u0, v0, u1, v1 = (corners * now[2] / before[2] + now[:2]).ravel().tolist()
            self.box_px = (u0, v0, u1, v1)
        self._centre_px = now

    def rebase(self) -> Float64Array:
        """Make the centre of the box the body's origin; returns (3,) m, where it was before."""
        assert self.box is not None
        offset = self.box.centre
        self.filter = self.filter.rebased(offset)
        self.shape.shift(offset)
        self.box = replace(self.box, centre=np.zeros(3))
        return offset

    def velocity_at(self, place: Float64Array) -> Float64Array:
        """(..., 3) m/s, world: of the body's material at places (..., 3) m, world."""
        mean = self.mean
        turning = turning_velocity(float(mean[YAW_RATE]), place - mean[POSITION])
        return np.asarray(mean[VELOCITY] + turning)

    def local(self, place: Float64Array) -> Float64Array:
        """(N, 3) metres, the body's frame, of places (N, 3) m, world."""
        return np.asarray((place - self.mean[POSITION]) @ self.R)

    def room(self, margin: float) -> float:
        """Metres by which points may lie outside the box, as a share of the longest side."""
        return 0.0 if self.box is None else margin * float(self.box.size.max())

    def contains(
        self, place: Float64Array, margin: Float64Array | float = 0.0
    ) -> NDArray[np.bool_]:
        """(N,) which places (N, 3) m, world, lie in the box made larger by the margin on all sides.

        Args:
            margin: metres; one for all, or (N,) one for each place.
        """
        if self.box is None:
            return np.zeros(len(place), np.bool_)
        return self.box.contains(self.local(place), margin)

    def corners(self) -> Float64Array:
        """(8, 3) metres, world: of the box; a single point before there is one."""
        if self.box is None:
            return np.broadcast_to(self.centre, (8, 3))
        R = self.R @ yaw_matrix(self.box.heading)
        return np.asarray(self.centre + (_CORNERS * self.box.size / 2) @ R.T)
