"""The outline of one body: its segment in the depth image, moved on with it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal

import cv2
import numpy as np

from observer.geometry import Float64Array, Pose
from observer.kernels.sight import sighting, view_of
from observer.methods.rigid.bodies.legs import is_other_leg
from observer.methods.rigid.bodies.trunk_depth import TrunkDepths
from observer.methods.rigid.bodies.trunk_view import TrunkView
from observer.methods.rigid.dense.grid import Grid
from observer.methods.rigid.dense.height import bottom_height
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import (
    SEGMENT_M2,
    UPRIGHT,
    Expected,
    Mask,
    Segment,
    box_px,
    extent_m,
    is_high,
    is_limb,
    with_limb,
)
from observer.methods.rigid.dense.silhouette import silhouette_px
from observer.types import BoxPx

# The part of a segment that locates its body: the middle or, if one side is hidden, the other side.
Anchor = Literal["middle", "left", "right", "none"]

# Metres, one standard deviation of an anchor across the line of sight: arms swing at the sides.
_ACROSS_M: dict[Anchor, float] = {"middle": 0.05, "left": 0.12, "right": 0.12, "none": 0.5}
# The same vertically, vertically where the body is cut off, and along the line of sight: metres,
# and cells of disparity.
_VERTICAL_M, _CUT_M, _ALONG_M, _ALONG_CELLS = 0.3, 0.5, 0.03, 0.175
# Metres, along the line of sight where one side is cut off: the disparity of a strip is partly
# that of its surroundings, for as long as it is a strip.
_CUT_ALONG_M = 0.3
# Cells, the part of a disparity's error that lasts, as its surroundings stay what they are.
_BIAS_CELLS = 0.25
# Cells, both for a disparity by the grey levels; and share of the cells that were uncovered, from
# which on a segment has no border of its own, and shows something else from frame to frame.
_FINE_ALONG_CELLS, _FINE_BIAS_CELLS, _BORDERLESS_SHARE = 0.1, 0.12, 0.5
# Cells: at this width half of a disparity is that of the surroundings.
_NARROW_CELLS = 6
# Seconds for which its last whole silhouette is kept for a body that is cut off.
_WHOLE_S = 1.0
# A standing body that shows less than this share of its silhouette is still expected as it was.
_LOST_SHARE = 0.9
# An outline is looked for while its scale, relative to the last silhouette, is between these.
_SCALES = (0.4, 2.5)
# Factor by which a body's extent may shrink per frame, as arms and legs swing.
_SHRINK = 0.97
# Shares of moved and of static cells that are evidence of motion, and of rest, in a frame.
_MOVED_SHARE, _STATIC_SHARE = 0.3, 0.6
_LEAST_APART, _LEAST_CLEAR = 0.4, 0.1
# Seconds for which a body is carried on between frames whose depth is known.
_CARRIED_S = 0.3
# A body that grows by this factor over static things is swallowing them.
_SWALLOWING = 1.6
# Metres above the ground: something that begins higher does not stand on it.
_HANGS_M = 0.6
# Something nearer hides what is below it if it is seen in this share of so many rows there.
_HIDDEN_SHARE, _BELOW_CELLS = 0.5, 3
# A body's middle lies behind its visible surface by this share of its width, or of so many metres
# if that is less.
_HALF_DEPTH, MOST_DEPTH_M = 0.25, 0.6


@dataclass(frozen=True, eq=False)
class _Silhouette:
    """A segment, with the body's origin (3,) m, world, and the pose at that time."""

    segment: Segment
    origin: Float64Array
    T_camera_world: Pose


@dataclass(eq=False)
class Outline:
    """The outline of one body over time.

    Attributes:
        segment: the last one. grid: of its cells. seen: in this frame.
        bias_px: one standard deviation of the lasting error of its disparity.
        offsets: (3,) metres, world, from the body's origin to each anchor.
        width, height: metres, largest of the recent ones. box_px: around it, see ``Obstacle``.
        middle: (3,) metres, world.
        carried_s: seconds since it was seen, during which it was assumed to move as predicted.
        trunk: as it last looked; None where little of it was seen. depths: of points on it.
        depth_by_points: points rather than the segment told its depth when it was last measured.
        only_legs: the trunk is above the image's upper border. legs_seen: it was at some time.
        arrived_frames, uncovered_frames: number of frames with evidence of motion of either kind.
        idle_frames: frames in a row in which it idled, see ``count_idle``.
        gap_frames: frames in a row in which there was a gap between two parts of it.
        hangs: nothing between it and the ground was seen to belong to it.
        found_small: it began as a small segment that stands alone.
        moving_area: largest while it moved, cells per px^2 of disparity, so at any distance.
    """

    segment: Segment
    grid: Grid
    moving_area: float
    seen: bool = True
    offsets: dict[Anchor, Float64Array] = field(default_factory=dict)
    width: float = 0.0
    height: float = 0.0
    box_px: BoxPx = (0.0, 0.0, 0.0, 0.0)
    middle: Float64Array = field(default_factory=lambda: np.zeros(3))
    arrived_frames: int = 0
    uncovered_frames: int = 0
    idle_frames: int = 0
    gap_frames: int = 0
    hangs: bool = False
    bias_px: float = 0.0
    carried_s: float = 0.0
    trunk: TrunkView | None = None
    depths: TrunkDepths = field(default_factory=TrunkDepths)
    depth_by_points: bool = False
    only_legs: bool = False
    found_small: bool = False
    legs_seen: bool = False
    _silhouette: _Silhouette | None = None
    _silhouette_s: float = 0.0

    @staticmethod
    def of(segment: Segment, scene: DenseScene) -> Outline:
        """Return the outline of a body that is first seen as a segment."""
        outline = Outline(segment, scene.grid, _shown(segment))
        outline.width, outline.height = extent_m(segment, scene.grid)
        outline.box_px = box_px(scene.grid, segment)
        return outline

    def lose_trunk(self) -> None:
        """Forget how the trunk looked and where points on it were: it is no longer seen."""
        self.trunk, self.depths = None, TrunkDepths()

    @property
    def silhouette(self) -> tuple[Float64Array, ...] | None:
        """Polygons (N, 2) px around the body in this frame, see ``Obstacle``; None if not seen."""
        return silhouette_px(self.segment.mask, self.grid) or None if self.seen else None

    @property
    def upright(self) -> bool:
        """True if it is taller than wide, like a person, whose limbs move on their own.

        A body that is cut off at the top may be a person.
        """
        return self.height > UPRIGHT * self.width or self.segment.cut[2]

    @property
    def is_small(self) -> bool:
        """True if it was found, and has stayed, smaller than a part of a person, like a ball."""
        return self.found_small and self.moving_area < SEGMENT_M2 * self.grid.per_metre(1.0) ** 2

    @property
    def is_high(self) -> bool:
        """True if it is as high as a part of a person, or fills much of the view's height."""
        return is_high(self.segment, self.grid)

    @property
    def merged(self) -> bool:
        """True while it does not stand apart from its surroundings."""
        return self.segment.apart < _LEAST_APART or self.segment.clear < _LEAST_CLEAR

    @property
    def beside_nearer(self) -> bool:
        """True while something nearer, rather than the image's border, cuts off a side of it."""
        (left, _, right, _), cut = self.segment.box, self.segment.cut
        return (cut[0] and left > 1) or (cut[1] and right < self.grid.width - 1)

    @property
    def is_static(self) -> bool:
        """True while most of it is seen where something was before."""
        return self.segment.static >= _STATIC_SHARE

    def expected(self, origin: Float64Array, T_camera_world: Pose, grid: Grid) -> Expected | None:
        """Return where it should be seen with the body's origin at (3,) m, world.

        None where that is out of sight, or too near or far to look the same.
        """
        assert self._silhouette is not None
        before = self._silhouette
        then, now, camera = before.T_camera_world, T_camera_world, grid.camera.numbers
        was = view_of(before.origin, then.rotation, then.translation, camera)
        seen = view_of(origin, now.rotation, now.translation, camera)
        scale = seen[2] / was[2]
        # The scale is NaN, and fails both comparisons, where a place is not before the camera.
        if not _SCALES[0] < scale < _SCALES[1]:
            return None
        (u0, v0), (u1, v1) = grid.to_cells(np.array([was[:2], seen[:2]]))
        move = np.array([[scale, 0.0, u1 - scale * u0], [0.0, scale, v1 - scale * v0]])
        mask = before.segment.mask.view(np.uint8)
        moved = cv2.warpAffine(mask, move, (grid.width, grid.height), flags=cv2.INTER_NEAREST)
        if not moved.any():
            return None
        return Expected(moved.view(np.bool_), before.segment.disparity * scale)

    def note(self, segment: Segment, origin: Float64Array, scene: DenseScene, age_s: float) -> None:
        """Note the segment at which it is seen now, with the body's origin at (3,) m, world."""
        self.segment, self.seen, self.carried_s = segment, True, 0.0
        self.box_px = box_px(scene.grid, segment)
        if not self.is_static:
            self.moving_area = max(self.moving_area, _shown(segment))
            self.arrived_frames += segment.arrived > _MOVED_SHARE
            self.uncovered_frames += segment.arrived <= _MOVED_SHARE < segment.uncovered
        width, height = extent_m(segment, scene.grid)
        self.width = max(width, _SHRINK * self.width)
        self.height = max(height, _SHRINK * self.height)
        bias = _FINE_BIAS_CELLS if _is_distinct(segment) else _BIAS_CELLS
        self.bias_px = bias * scene.grid.reduction * _narrowness(segment)
        self.hangs = _hangs(segment, scene)
        self._keep_silhouette(origin, scene, age_s)
        surface, _ = measured_anchor(segment, "middle", scene)
        ahead = surface - scene.T_world_camera.translation
        depth = _HALF_DEPTH * min(self.width, MOST_DEPTH_M)
        self.middle = surface + depth * ahead / np.linalg.norm(ahead)

    def carry(
        self, origin: Float64Array, velocity: Float64Array, T_camera_world: Pose, dt: float
    ) -> None:
        """Treat it as seen where it is expected, in a frame whose depth is not known.

        Args:
            origin: (3,) metres, world, of the body. velocity: (3,) m/s.
        """
        self.carried_s += dt
        where = None
        if self.seen and self.carried_s < _CARRIED_S:
            where = self.expected(origin, T_camera_world, self.grid)
        self.seen = where is not None
        if where is not None:
            self.segment = where.as_segment(self.segment)
            self.box_px = box_px(self.grid, self.segment)
            self.middle = self.middle + dt * velocity

    def take(self, limb: Segment, scene: DenseScene, heading: Float64Array | None) -> bool:
        """Take a segment as a limb of the body, if it is one; returns whether it is.

        Args:
            heading: (3,) unit vector, world, in which the body moves; None if unknown.
        """
        leg = self.only_legs and is_other_leg(scene, limb, self.segment, heading)
        if not leg and not is_limb(scene, limb, self.segment):
            return False
        self.segment = with_limb(scene, self.segment, limb)
        self.box_px = box_px(scene.grid, self.segment)
        if self._silhouette is not None and anchor_of(self.segment) == "middle":
            self._silhouette = replace(self._silhouette, segment=self.segment)
        return True

    def move_origin(self, offset: Float64Array) -> None:
        """Make another point of the body its origin, (3,) m, world, away from the old one."""
        self.offsets.clear()
        if self._silhouette is not None:
            self._silhouette = replace(self._silhouette, origin=self._silhouette.origin + offset)

    def count_idle(self, *, tentative: bool, may_stand: bool) -> int:
        """Count the frames in a row in which it is merged or stands, and has grown much.

        A tentative one counts as idle even without growing, unless it may stand: a person who only
        begins to walk, or comes straight on, is still mostly where they were.
        """
        grown = _shown(self.segment) > _SWALLOWING * self.moving_area
        static = self.is_static and not (tentative and may_stand)
        idle = self.seen and (self.merged or static) and (tentative or grown)
        self.idle_frames = self.idle_frames + 1 if idle else 0
        return self.idle_frames

    def _keep_silhouette(self, origin: Float64Array, scene: DenseScene, age_s: float) -> None:
        """Keep the silhouette that shows most of a body while it is cut off: it will reappear."""
        if self._silhouette is not None and age_s - self._silhouette_s <= _WHOLE_S:
            share = _shown(self.segment) / _shown(self._silhouette.segment)
            lost = self.is_static and share < _LOST_SHARE
            if share < 1 and (lost or anchor_of(self.segment) != "middle"):
                return
        self._silhouette = _Silhouette(self.segment, origin, scene.T_camera_world)
        self._silhouette_s = age_s


def _hangs(segment: Segment, scene: DenseScene) -> bool:
    """Return whether a segment ends far above the ground, and nothing cuts it off there."""
    if scene.ground is None or segment.cut[3]:
        return False
    left, _, right, bottom = segment.box
    below = scene.disparity[bottom : bottom + _BELOW_CELLS, left:right]
    nearer = below > segment.disparity + scene.tolerance(segment.disparity)
    if nearer.mean() > _HIDDEN_SHARE:
        return False
    return bottom_height(segment, scene, scene.ground) > _HANGS_M


def _shown(segment: Segment) -> float:
    """Return how much of a body is seen, cells per px^2 of disparity, so at any distance."""
    return segment.area / segment.disparity**2


def anchor_of(segment: Segment) -> Anchor:
    """Return which part of the trunk locates the body."""
    match segment.cut[:2]:
        case (False, False):
            return "middle"
        case (True, False):
            return "right"
        case (False, True):
            return "left"
        case _:
            return "none"


def measured_anchor(
    segment: Segment, anchor: Anchor, scene: DenseScene
) -> tuple[Float64Array, Float64Array]:
    """Return where an anchor is seen, (3,) m, world, and its covariance (3, 3)."""
    camera, pose = scene.grid.camera, scene.T_world_camera
    left, middle, right = segment.columns
    column = {"left": left, "right": right}.get(anchor, middle)
    row = (segment.box[1] + segment.box[3] - 1) / 2
    u, v = scene.grid.to_px(np.array([column, row])).tolist()
    disparity = segment.best_disparity
    noise = _FINE_ALONG_CELLS if _is_distinct(segment) else _ALONG_CELLS
    noise_m = noise * scene.grid.reduction * camera.fx * camera.baseline / disparity**2
    along_m = _narrowness(segment) * math.hypot(noise_m, _ALONG_M)
    down_m = _CUT_M if segment.cut[2] or segment.cut[3] else _VERTICAL_M
    if any(segment.cut[:2]):
        along_m = max(along_m, _CUT_ALONG_M)
    return sighting(
        u, v, disparity, _ACROSS_M[anchor], down_m, along_m,
        pose.rotation, pose.translation, camera.numbers,
    )  # fmt: skip


def _is_distinct(segment: Segment) -> bool:
    """Return whether the grey levels tell a segment's disparity, and it has borders of its own."""
    bordered = segment.uncovered < _BORDERLESS_SHARE and not any(segment.cut[:2])
    return segment.fine is not None and bordered


def _narrowness(segment: Segment) -> float:
    """Return how many times less certain a segment's disparity is than that of a wide one."""
    left, _, right = segment.columns
    return 1 + _NARROW_CELLS / (right - left + 1)


def free_cells(outlines: list[Outline], grid: Grid) -> Mask:
    """(h, w) the cells that lie on no visible outline."""
    free = np.ones(grid.shape, np.bool_)
    for outline in outlines:
        if outline.seen:
            free &= ~outline.segment.mask
    return free
