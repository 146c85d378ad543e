"""Worlds of boxes on a flat ground, whose disparity is known exactly; no image is rendered."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import yaw_matrix
from observer.methods.rigid.bodies.outline import Outline
from observer.methods.rigid.bodies.segment_tracking import track_segments
from observer.methods.rigid.bodies.tracker import BodyTracker
from observer.methods.rigid.camera_step import CameraStep
from observer.methods.rigid.dense.depth_image import RowTexture
from observer.methods.rigid.dense.free_space import ARRIVED, STATIC, DepthFrame, FreeSpace
from observer.methods.rigid.dense.grey_change import Light
from observer.methods.rigid.dense.grid import Grid
from observer.methods.rigid.dense.ground import Ground, GroundPlane, above_ground, near_enough
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import segment_of
from observer.methods.rigid.motion_test import pooled_motion
from observer.methods.rigid.position_velocity_filter import PositionVelocityFilter
from observer.methods.rigid.tracked_points import TrackedPoints, WorldSightings
from observer.mount import CameraMount
from observer.parameters import Parameters
from observer.vision.camera_rate import CameraRate
from observer.vision.lifecycle import TrackIds

CAMERA = StereoCamera(640, 400, 500.0, 500.0, 319.5, 199.5, 0.12)
GRID = Grid.of(CAMERA)
HERE = Pose.identity()
# (h, w) every cell.
ALL = np.ones(GRID.shape, np.bool_)
HEIGHT_M = 1.0
MOUNT = CameraMount(HEIGHT_M, 0.0)
DT = 0.1


@dataclass(frozen=True, eq=False)
class Solid:
    """A box: centre (3,) and size (3,) m, world (x right, y down, z ahead); yaw as of a body."""

    centre: Sequence[float]
    size: Sequence[float]
    yaw: float = 0.0

    def depth(self, eye: Float64Array, rays: Float64Array) -> Float64Array:
        """(h, w) ray lengths, in units of rays (h, w, 3), to its surface; inf where missed."""
        R = yaw_matrix(self.yaw)
        origin, direction = (eye - np.asarray(self.centre)) @ R, rays @ R
        half = np.asarray(self.size) / 2
        with np.errstate(divide="ignore", invalid="ignore"):
            one, other = (-half - origin) / direction, (half - origin) / direction
        enters = np.fmin(one, other).max(axis=-1)
        leaves = np.fmax(one, other).min(axis=-1)
        return np.where((enters < leaves) & (enters > 0), enters, np.inf)


@dataclass(frozen=True, eq=False)
class Plane:
    """The places with ``normal . X = offset``, metres, world."""

    normal: Sequence[float]
    offset: float

    def depth(self, eye: Float64Array, rays: Float64Array) -> Float64Array:
        """(h, w) as in ``Solid.depth``."""
        normal = np.asarray(self.normal)
        with np.errstate(divide="ignore"):
            found = (self.offset - float(normal @ eye)) / (rays @ normal)
        return np.where(found > 0, found, np.inf)


Shape = Solid | Plane
# The ground below a level camera at ``HEIGHT_M``, and a wall far behind all else.
FLOOR = Plane((0.0, 1.0, 0.0), HEIGHT_M)
WALL = Plane((0.0, 0.0, 1.0), 8.0)
ROOM: tuple[Shape, ...] = (FLOOR, WALL)


def on_floor(x: float, z: float, size: Sequence[float], yaw: float = 0.0) -> Solid:
    """A box that stands on the floor."""
    return Solid((x, HEIGHT_M - size[1] / 2, z), size, yaw)


def person(x: float, z: float) -> Solid:
    return on_floor(x, z, (0.45, 1.6, 0.25))


def disparity_of(
    shapes: Sequence[Shape], T_world_camera: Pose = HERE, grid: Grid = GRID
) -> NDArray[np.float32]:
    """(h, w) px, exact; NaN where there is nothing."""
    depth = np.full(grid.shape, np.inf)
    for shape in shapes:
        depth = np.minimum(depth, _depth_of(shape, T_world_camera, grid))
    disparity = grid.camera.fx * grid.camera.baseline / depth
    return np.where(np.isfinite(depth), disparity, np.nan).astype(np.float32)


@lru_cache(maxsize=16)
def _depth_of(shape: Shape, T_world_camera: Pose, grid: Grid) -> Float64Array:
    """(h, w) metres; cached, since most tests ask for the same room several times."""
    return shape.depth(T_world_camera.translation, _rays(T_world_camera, grid))


@lru_cache(maxsize=4)
def _rays(T_world_camera: Pose, grid: Grid) -> Float64Array:
    """(h, w, 3) world, of depth 1."""
    h, w = grid.shape
    cells = np.stack([*np.meshgrid(np.arange(w), np.arange(h)), np.ones((h, w))], axis=-1)
    return T_world_camera.rotate(cells @ grid.rays.T)


def cells_of(
    shape: Shape, shapes: Sequence[Shape], T_world_camera: Pose = HERE
) -> NDArray[np.bool_]:
    """(h, w) the cells in which this shape is seen in front of the others."""
    others = [s for s in shapes if s is not shape]
    behind = disparity_of(others, T_world_camera) if others else np.zeros(GRID.shape)
    here = disparity_of([shape], T_world_camera)
    return np.asarray(np.nan_to_num(here) > np.nan_to_num(behind))


def seen(
    shapes: Sequence[Shape],
    T_world_camera: Pose = HERE,
    evidence: NDArray[np.uint8] | None = None,
) -> DenseScene:
    """The scene of these shapes; without evidence its motion is unknown."""
    disparity = disparity_of(shapes, T_world_camera)
    plane = Ground(GRID, MOUNT).plane(T_world_camera.inverse())
    near = near_enough(disparity, GRID)
    if evidence is None:
        evidence = np.zeros(GRID.shape, np.uint8)
    dark = np.zeros(GRID.shape, np.uint8)
    unchanged = np.zeros(GRID.shape, np.bool_)
    ground = GroundPlane(np.array([0.0, 1.0, 0.0]), HEIGHT_M)
    return DenseScene(
        time=0.0,
        grid=GRID,
        T_world_camera=T_world_camera,
        left=dark,
        right=dark,
        texture=RowTexture.of(dark),
        matched=disparity,
        disparity=disparity,
        near=near,
        standing=near & above_ground(disparity, plane, GRID),
        evidence=evidence,
        changed=unchanged,
        light=Light(),
        ground=ground,
    )


def cells(scene: DenseScene, thing: Shape, *others: Shape) -> NDArray[np.bool_]:
    """(h, w) where a thing is seen in front of the room and others, and stands out."""
    return cells_of(thing, [*ROOM, thing, *others]) & scene.standing


def overlap(one: NDArray[np.bool_], other: NDArray[np.bool_]) -> float:
    """Share of all their cells that two masks (h, w) have in common."""
    return float((one & other).sum() / (one | other).sum())


def outline_of(thing: Solid, evidence: int | None = None) -> Outline:
    """The outline of a thing in a room.

    Args:
        evidence: of its cells, while the room is static; no evidence anywhere if left out.
    """
    shapes = [*ROOM, thing]
    mask = cells_of(thing, shapes)
    every = None if evidence is None else np.where(mask, evidence, STATIC).astype(np.uint8)
    scene = seen(shapes, evidence=every)
    return Outline.of(segment_of(scene, mask), scene)


def arrived(*things: Shape) -> DenseScene:
    """Things in a room that was empty before."""
    shapes = [*ROOM, *things]
    evidence = np.full(GRID.shape, STATIC, np.uint8)
    for thing in things:
        evidence[cells_of(thing, shapes)] = ARRIVED
    return seen(shapes, evidence=evidence)


def step_to(T_world_camera: Pose = HERE, dt: float = DT) -> CameraStep:
    """A camera step that ends at a precisely known pose."""
    covariance = np.eye(6) * 1e-12
    return CameraStep(CAMERA, T_world_camera.inverse(), covariance, CameraRate.still(), dt)


class SolidView:
    """Sees worlds of solids over time by depth alone: no points are tracked.

    Attributes:
        time: seconds. scene: of the newest frame. tracker: with its tracks.
    """

    def __init__(self) -> None:
        self.tracker = BodyTracker()
        self.time = 0.0
        self.scene = seen([])
        self._space = FreeSpace(GRID)
        self._points = TrackedPoints.none()

    @property
    def tracks(self) -> list[BodyTrack]:
        return self.tracker.tracks

    def look(self, shapes: Sequence[Shape], T_world_camera: Pose = HERE) -> DenseScene:
        """Add a frame, without tracking."""
        self.time += DT
        bare = seen(shapes, T_world_camera)
        frame = DepthFrame(self.time, bare.disparity, T_world_camera.inverse())
        evidence = self._space.evidence(frame, bare.standing)
        self._space.keep(frame)
        self.scene = seen(shapes, T_world_camera, evidence)
        return self.scene

    def step(self, shapes: Sequence[Shape], T_world_camera: Pose = HERE) -> list[BodyTrack]:
        """Add a frame; return the tracks."""
        scene, now = self.look(shapes, T_world_camera), step_to(T_world_camera)
        p = Parameters()
        motion = pooled_motion(self._points, now, p.evidence)
        sightings = WorldSightings(np.zeros((0, 3)), np.zeros((0, 3, 3)))
        self._points = self.tracker.step(self._points, sightings, motion, scene, now, p)
        return self.tracks


def tracked(
    tracks: list[BodyTrack],
    points: TrackedPoints,
    scene: DenseScene,
    numbers: TrackIds | None = None,
) -> TrackedPoints:
    """Find the tracks' segments in a scene, and new ones; points learn their places on them."""
    least = Parameters().obstacles.min_points
    return track_segments(tracks, points, scene, step_to(), numbers or TrackIds(), least)


def outlined(shape: Shape, numbers: TrackIds) -> tuple[list[BodyTrack], BodyTrack]:
    """The list of tracks, and in it the track of a person who has just arrived."""
    tracks: list[BodyTrack] = []
    tracked(tracks, TrackedPoints.none(), arrived(shape), numbers)
    (host,) = tracks
    return tracks, host


def points_on(*places: Float64Array) -> TrackedPoints:
    """Points at groups of places (K, 3) m, owned by obstacles 1, 2, ... in turn."""
    every = np.concatenate(places)
    px, disparity = CAMERA.project(every)
    px32 = px.astype(np.float32)
    sums = PositionVelocityFilter.begin(every, np.tile(np.eye(3) * 1e4, (len(every), 1, 1)))
    owner = np.repeat(np.arange(1, len(places) + 1), [len(p) for p in places])
    return TrackedPoints.begin(0, px32, px32, disparity, sums).but(obstacle=owner)


def patch(x: float, y: float, z: float, side: float = 0.2) -> Float64Array:
    """(9, 3) metres, on an upright square."""
    across = np.linspace(-side / 2, side / 2, 3)
    return np.array([[x + a, y + b, z] for a in across for b in across])
