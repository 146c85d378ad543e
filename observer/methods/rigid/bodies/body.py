"""One obstacle over time: its motion, its size and the state of its track."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import BOX_CORNERS, Float64Array, Pose, mahalanobis
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
from observer.methods.rigid.bodies.image_growth import Growth
from observer.methods.rigid.bodies.outline import Outline
from observer.methods.rigid.bodies.recent_motion import RecentMotion
from observer.methods.rigid.bodies.scatter import Scatter
from observer.methods.rigid.bodies.shape import BodyShape, Box
from observer.methods.rigid.bodies.steady_drive import SteadyDrive
from observer.types import BoxPx, MotionState, TrackState

# Seconds out of sight after which a body's motion counts as unknown.
_FORGOTTEN_S = 0.4
_NOWHERE = np.zeros(3)
# Standard deviations of a velocity from which its direction is known.
_HEADING_SIGMAS = 2.0
# (m/s)^2: by how much a limb's velocity differs from that of its body.
_LIMB_COV = np.diag([0.5, 0.05, 0.5]) ** 2


@dataclass(eq=False)
class BodyTrack:
    """One obstacle over time.

    Attributes:
        id: as of ``Obstacle``. state, motion: as reported.
        filter: position, velocity, yaw. The position is the body's own origin, not its centre.
        recent: its motion of the last seconds.
        shape: where its points are in its own frame. box: in that frame; None before the first
            update.
        points: members seen in this frame. frames: since it began. missed_s: seconds since it
            was last seen. age_s: seconds since it began. steady_s: since it last manoeuvred.
        hits: frames in which it moved significantly, less those since in which it did not.
            sightings: of members in the former, beyond the few whose errors may be alike.
        significance: Mahalanobis length of the velocity.
        box_px: u0 v0 u1 v1 in the left image, around its visible part; while it is out of sight,
            where that should be by now.
        scatter: of how its points move, while it counts as rigid; None if unknown.
        lasting_cov: (3, 3) (m/s)^2, world: of the velocity, by errors that time does not reduce.
        outline: its outline in the depth image; None before one was found.
        rigid: False once its limbs were seen to move on their own, or while no point is known to
            move with it. rigidity: recent share of its points that move with it. loosened: its
            motion came from points that moved as one, but may have been on a limb.
        by_points: its points measured it in this frame.
        drive: for how long points on it have moved steadily as one.
        changes: when something on it looked different from a moment before.
        crosses: its points show, as surely as confirmation needs, that it crosses the view.
        part_moves: it began as a whole person, of whom only a part was seen to move.
        merged_s: seconds for which its points were seen, but no segment separate from its
            surroundings.
        off_ground: no more than half of its points are on cells that do not stand out of the
            ground. lies: more than half of them lie on it, by their own disparities.
        wrong_match: while tentative: recent share of its points that match as well where a wrong
            match would explain how it moves; None if none would, or too few can be compared.
        among_static: while tentative: static points are seen among its own.
        far: it is seen by points alone, too far away to tell whether they approach or recede.
        growth: of its image, while tentative.
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
    box_px: BoxPx = (0.0, 0.0, 0.0, 0.0)
    scatter: Scatter | None = None
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
    off_ground: bool = True
    lies: bool = False
    wrong_match: float | None = None
    among_static: bool = False
    far: bool = False
    growth: Growth = field(default_factory=Growth)
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
        """(3,) metres, world: the centre of the box."""
        offset = np.zeros(3) if self.box is None else self.R @ self.box.centre
        return self.mean[POSITION] + offset

    @property
    def seen_outline(self) -> Outline | None:
        """Its outline, if it is seen in this frame."""
        return None if self.outline is None or not self.outline.seen else self.outline

    def centre_velocity(self) -> tuple[Float64Array, Float64Array]:
        """Return the velocity (3,) m/s, world, of the centre, and its covariance (3, 3).

        For a turning body it depends on where the centre is, which is not known exactly.
        """
        arm, doubt_m = _NOWHERE, 0.0
        if self.box is not None:
            arm = self.R @ self.box.centre
            width, _, length = self.box.size.tolist()
            doubt_m = self.shape.centre_doubt * max(width, length)
        return velocity_at_centre(self.mean, self.filter.covariance, arm, self.lasting_cov, doubt_m)

    @property
    def heading(self) -> Float64Array | None:
        """(3,) unit vector, world, in which it moves; None while that is not known."""
        velocity = self.mean[VELOCITY]
        cov = self.filter.covariance[VELOCITY, VELOCITY]
        known = mahalanobis(velocity, cov) > _HEADING_SIGMAS
        return velocity / float(np.linalg.norm(velocity)) if known else None

    @property
    def forgotten(self) -> bool:
        """True if it has been out of sight so long that it may move in any way."""
        return self.missed_s > _FORGOTTEN_S

    def loosen(self) -> None:
        """Treat it as a body with limbs, whose yaw is unknown.

        What moved as one until now may have been a limb, faster or slower than the body, so the
        velocity becomes less certain; but not if only legs are in view, as nothing tells better.
        """
        self.rigid, self.rigidity, self.loosened, self.scatter = False, 0.0, True, None
        self.filter = self.filter.straightened()
        if self.outline is None or not self.outline.only_legs:
            self.filter = self.filter.doubted(_LIMB_COV)

    def stiffen(self, motion: BodyFilter) -> None:
        """Treat it as a rigid body, with the motion found from points on it."""
        self.rigid, self.rigidity, self.loosened = True, 1.0, False
        self.restart(motion)

    def restart(self, motion: BodyFilter) -> None:
        """Start over with a motion; forget the old one and where points were. ID and size stay."""
        if self.outline is not None:
            self.outline.move_origin(motion.mean[POSITION] - self.mean[POSITION])
        self.filter = motion
        self.shape.forget()
        self.recent.forget()

    def become(self, part: BodyTrack) -> None:
        """Go on as a part of what was taken for one body; ID and state stay."""
        self.filter, self.shape, self.outline = part.filter, part.shape, part.outline
        self.recent, self.box, self.points = part.recent, None, 0
        self.rigid, self.rigidity, self.by_points, self.scatter = False, 0.0, False, None

    def carry_box(self, T_camera_world: Pose, camera: StereoCamera) -> None:
        """Move the image box of a body out of sight to where it is expected in this frame."""
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
        """Make the centre of the box the origin; returns where it was in the old frame, (3,) m."""
        assert self.box is not None
        offset = self.box.centre
        self.filter = self.filter.rebased(offset)
        self.shape.shift(offset)
        self.box = replace(self.box, centre=np.zeros(3))
        return offset

    def velocity_at(self, place: Float64Array) -> Float64Array:
        """(..., 3) m/s, world: velocity of the body's material at places (..., 3) m, world."""
        mean = self.mean
        turning = turning_velocity(float(mean[YAW_RATE]), place - mean[POSITION])
        return np.asarray(mean[VELOCITY] + turning)

    def local(self, place: Float64Array) -> Float64Array:
        """Return places (N, 3) m, world, in the body's frame."""
        return np.asarray((place - self.mean[POSITION]) @ self.R)

    def room(self, margin: float) -> float:
        """Metres by which points may lie outside the box: a share of its longest side."""
        return 0.0 if self.box is None else margin * float(self.box.size.max())

    def contains(
        self, place: Float64Array, margin: Float64Array | float = 0.0
    ) -> NDArray[np.bool_]:
        """(N,) which places (N, 3) m, world, lie in the box enlarged by the margin on all sides.

        Args:
            margin: metres; one for all, or (N,) one for each place.
        """
        if self.box is None:
            return np.zeros(len(place), np.bool_)
        return self.box.contains(self.local(place), margin)

    def corners(self) -> Float64Array:
        """(8, 3) metres, world: corners of the box; all at one point before there is one."""
        if self.box is None:
            return np.broadcast_to(self.centre, (8, 3))
        R = self.R @ yaw_matrix(self.box.heading)
        return np.asarray(self.centre + (BOX_CORNERS * self.box.size / 2) @ R.T)
