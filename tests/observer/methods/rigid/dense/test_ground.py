"""The ground plane: found from any height and tilt, and distinguished from walls and objects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from observer.geometry import Pose
from observer.methods.rigid.dense.ground import (
    Ground,
    GroundPlane,
    above_ground,
    near_enough,
    tells_approach,
)
from observer.mount import CameraMount

from ..solid_worlds import (
    FLOOR,
    GRID,
    HEIGHT_M,
    HERE,
    MOUNT,
    ROOM,
    WALL,
    Plane,
    Shape,
    Solid,
    cells_of,
    disparity_of,
    on_floor,
)

quick = settings(max_examples=10)
NOISE_PX = 0.15


def plane_below(mount: CameraMount) -> Plane:
    """The ground in the frame of a camera with this mount."""
    return Plane(mount.down.tolist(), mount.height_m)


def noisy(disparity: np.ndarray, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0, NOISE_PX, disparity.shape)
    return (disparity + noise).astype(np.float32)


def plane_image(plane: np.ndarray) -> np.ndarray:
    """(h, w) px of a plane a, b, c."""
    rows, columns = np.indices(GRID.shape)
    return plane[0] * columns + plane[1] * rows + plane[2]


def assert_same_ground(plane: np.ndarray | None, true: Plane, pose: Pose = HERE) -> None:
    assert plane is not None
    truth = disparity_of([true], pose)
    on = np.isfinite(truth)
    error = np.abs(plane_image(plane) - truth)[on] / (1 + 0.05 * truth[on])
    # The threshold for standing cells is larger than this.
    assert error.max() < 0.5


def looking(pitch: float, roll: float = 0.0, place: Sequence[float] = (0, 0, 0)) -> Pose:
    """A camera that looks down by ``pitch`` rad, and leans to its side."""
    lean = Pose.from_rotvec([0.0, 0.0, roll], np.zeros(3))
    return Pose.from_rotvec([-pitch, 0.0, 0.0], place) @ lean


mounts = st.builds(
    CameraMount,
    height_m=st.floats(0.2, 2.5),
    tilt_rad=st.floats(-0.1, 0.6),
    roll_rad=st.floats(-0.15, 0.15),
)


@quick
@given(mount=mounts, seed=st.integers(0, 99))
def test_the_ground_is_found_from_any_height_and_tilt(mount: CameraMount, seed: int) -> None:
    true = plane_below(mount)
    ground = Ground(GRID, None)
    assert ground.plane(HERE) is None
    ground.update(noisy(disparity_of([true]), seed), HERE, seed)
    assert_same_ground(ground.plane(HERE), true)


@quick
@given(mount=mounts)
def test_a_mount_gives_the_ground_before_anything_is_seen(mount: CameraMount) -> None:
    assert_same_ground(Ground(GRID, mount).plane(HERE), plane_below(mount))


@quick
@given(pitch=st.floats(-0.2, 0.3), x=st.floats(-2, 2), z=st.floats(-2, 2), up=st.floats(-0.5, 0.5))
def test_the_ground_is_fixed_in_the_world_while_the_camera_moves(
    pitch: float, x: float, z: float, up: float
) -> None:
    pose = looking(pitch, 0.05, (x, -up, z))
    assert_same_ground(Ground(GRID, MOUNT).plane(pose.inverse()), FLOOR, pose)


@quick
@given(pitch=st.floats(0.0, 0.3), x=st.floats(-2, 2))
def test_a_ground_found_at_one_pose_is_right_at_another(pitch: float, x: float) -> None:
    first = looking(pitch)
    ground = Ground(GRID, None)
    ground.update(disparity_of([FLOOR], first), first.inverse(), 0)
    later = looking(0.1, 0.05, (x, -0.2, 1.0))
    assert_same_ground(ground.plane(later.inverse()), FLOOR, later)


@pytest.mark.parametrize(("height", "tilt"), [(HEIGHT_M + 0.06, 0.0), (HEIGHT_M, 0.015)])
def test_a_slightly_wrong_mount_is_corrected_by_images(height: float, tilt: float) -> None:
    ground = Ground(GRID, CameraMount(height, tilt))
    for k in range(60):
        ground.update(noisy(disparity_of(ROOM), k), HERE, k)
    assert_same_ground(ground.plane(HERE), FLOOR)


def test_the_ground_is_found_among_objects_on_it() -> None:
    room = [*ROOM, on_floor(-1.0, 3.0, (0.6, 0.5, 0.6), 0.4), on_floor(0.9, 4.0, (0.5, 1.5, 0.5))]
    ground = Ground(GRID, None)
    ground.update(noisy(disparity_of(room)), HERE, 3)
    assert_same_ground(ground.plane(HERE), FLOOR)


@quick
@given(
    yaw=st.floats(-1.2, 1.2),
    distance=st.floats(0.6, 8.0),
    pitch=st.floats(-0.2, 0.5),
    seed=st.integers(0, 99),
)
def test_walls_are_never_taken_for_the_ground(
    yaw: float, distance: float, pitch: float, seed: int
) -> None:
    wall = Plane((np.sin(yaw), 0.0, np.cos(yaw)), distance)
    pose = looking(pitch)
    ground = Ground(GRID, None)
    for k in range(3):
        ground.update(noisy(disparity_of([wall], pose), seed + k), pose.inverse(), seed + k)
    assert ground.plane(pose.inverse()) is None


@quick
@given(yaw=st.floats(-1.2, 1.2), distance=st.floats(1.0, 8.0))
def test_walls_do_not_change_a_known_ground(yaw: float, distance: float) -> None:
    wall = Plane((np.sin(yaw), 0.0, np.cos(yaw)), distance)
    ground = Ground(GRID, MOUNT)
    disparity = noisy(disparity_of([wall]))
    for k in range(10):
        ground.update(disparity, HERE, k)
    assert_same_ground(ground.plane(HERE), FLOOR)


def test_a_table_does_not_replace_a_known_ground() -> None:
    table = Solid((0.0, 0.4, 3.0), (2.0, 0.04, 2.0))
    ground = Ground(GRID, MOUNT)
    for k in range(10):
        ground.update(disparity_of([*ROOM, table]), HERE, k)
    assert_same_ground(ground.plane(HERE), FLOOR)


def test_the_ground_is_unchanged_when_nothing_is_seen() -> None:
    unknown = np.full(GRID.shape, np.nan, np.float32)
    for mount in (None, MOUNT):
        ground = Ground(GRID, mount)
        before = ground.plane(HERE)
        ground.update(unknown, HERE, 0)
        np.testing.assert_equal(ground.plane(HERE), before)


def test_there_is_no_ground_for_a_camera_below_it() -> None:
    under = Pose(np.eye(3), np.array([0.0, HEIGHT_M + 0.1, 0.0]))
    assert Ground(GRID, MOUNT).plane(under.inverse()) is None


def test_the_same_seed_gives_an_identical_ground() -> None:
    disparity = noisy(disparity_of(ROOM))
    planes = []
    for _ in range(2):
        ground = Ground(GRID, None)
        ground.update(disparity, HERE, 7)
        planes.append(ground.plane(HERE))
    np.testing.assert_array_equal(planes[0], planes[1])


# --- above the ground ----------------------------------------------------------------------


PLANE = Ground(GRID, MOUNT).plane(HERE)


def above_ground_cells(shapes: Sequence[Shape]) -> np.ndarray:
    return above_ground(disparity_of(shapes), PLANE, GRID)


@quick
@given(x=st.floats(-1, 1), z=st.floats(2, 5), yaw=st.floats(-1, 1))
def test_objects_are_above_the_ground_and_the_ground_is_not(x: float, z: float, yaw: float) -> None:
    crate = on_floor(x, z, (0.5, 0.8, 0.4), yaw)
    room: list[Shape] = [FLOOR, crate]
    found, true = above_ground_cells(room), cells_of(crate, room)
    assert not found[~true].any()
    # near its foot it is not nearer than the ground
    rows = np.flatnonzero(true.any(axis=1))
    upper = true & (np.arange(GRID.height)[:, None] < rows[0] + 0.6 * len(rows))
    assert found[upper].all()


def test_noise_of_the_ground_is_not_above_it() -> None:
    assert above_ground(noisy(disparity_of([FLOOR])), PLANE, GRID).mean() < 1e-3


def test_reflections_in_the_ground_are_not_above_it() -> None:
    """A box's mirror image is seen below the ground, as far below as the box is above."""
    mirrored = Solid((0.0, HEIGHT_M + 0.6, 3.0), (0.5, 1.2, 0.4))
    disparity = disparity_of([FLOOR])
    image = cells_of(mirrored, [mirrored])
    disparity[image] = disparity_of([mirrored])[image]
    assert image.sum() > 200
    assert not above_ground(disparity, PLANE, GRID).any()


@given(
    x=st.floats(-1.0, 1.0),
    z=st.floats(1.0, 6.0),
    high=st.floats(0.1, 0.8),
    pitch=st.floats(-0.1, 0.2),
)
def test_what_is_on_or_below_the_ground_lies_and_what_is_above_does_not(
    x: float, z: float, high: float, pitch: float
) -> None:
    down = np.array([0.0, math.cos(pitch), math.sin(pitch)])
    ground = GroundPlane(down, 0.9, mounted=True)
    level = np.array([x, 0.0, z])
    foot = level + (0.9 - down @ level) * down
    places = np.stack([foot - high * down, foot, foot + high * down])
    assume((places[:, 2] > 0.3).all())
    px, disparity = GRID.camera.project(places)
    lies = ground.carries(px.astype(np.float32), disparity, HERE, GRID.camera)
    # Where disparity is small, low things cannot be told from the ground.
    excess = disparity[0] * high / 0.9
    assert lies[1:].all()
    if excess > 0.2 + 0.04 * disparity[0]:
        assert not lies[0]
    # Nothing is known of points without disparity.
    assert not ground.carries(px.astype(np.float32), np.full(3, np.nan), HERE, GRID.camera).any()
    # What is seen without a mount may be a table.
    seen = GroundPlane(down, 0.9)
    assert not seen.carries(px.astype(np.float32), disparity, HERE, GRID.camera).any()


def test_nothing_lies_on_a_ground_above_the_camera() -> None:
    ground = GroundPlane(np.array([0.0, 1.0, 0.0]), -0.5, mounted=True)
    px, disparity = GRID.camera.project(np.array([[0.1, 0.4, 3.0], [0.1, -0.5, 3.0]]))
    assert not ground.carries(px.astype(np.float32), disparity, HERE, GRID.camera).any()


def test_everything_above_the_horizon_is_above_the_ground() -> None:
    for z in (6.0, 20.0):
        assert above_ground_cells([Plane((0.0, 0.0, 1.0), z)])[: GRID.height // 2 - 2].all()


def test_unknown_cells_are_never_above_the_ground() -> None:
    disparity = disparity_of([FLOOR, WALL])
    disparity[::2] = np.nan
    assert not above_ground(disparity, PLANE, GRID)[::2].any()
    assert not above_ground(disparity, None, GRID)[::2].any()
    assert not near_enough(disparity, GRID)[::2].any()


def test_everything_is_above_an_unknown_ground() -> None:
    near = Plane((0.0, 0.0, 1.0), 6.0)
    assert above_ground(disparity_of([FLOOR, near]), None, GRID).all()


@pytest.mark.parametrize(
    ("baseline_m", "reach_m"),
    [(0.03, 3.75), (0.06, 6.6), (0.12, 7.5), (0.4, 25.0)],
)
def test_the_reach_depends_on_the_baseline(baseline_m: float, reach_m: float) -> None:
    """The usual reach for a person, less where depth is too noisy, more where it is precise."""
    grid = replace(GRID, camera=replace(GRID.camera, baseline=baseline_m))
    for z, near in ((0.95 * reach_m, True), (1.05 * reach_m, False)):
        disparity = np.full(grid.shape, grid.camera.fx * baseline_m / z, np.float32)
        assert (near_enough(disparity, grid) == near).all()


@pytest.mark.parametrize(
    ("baseline_m", "flickers", "reach_m"),
    [(0.05, False, 3.6), (0.05, True, 2.5), (0.12, False, 7.5), (0.12, True, 6.0)],
)
def test_points_tell_approach_where_cells_can_be_judged_and_nearer_in_flickering_light(
    baseline_m: float, reach_m: float, *, flickers: bool
) -> None:
    grid = replace(GRID, camera=replace(GRID.camera, baseline=baseline_m))
    at, beyond = (grid.camera.fb / reach for reach in (0.97 * reach_m, 1.03 * reach_m))
    assert tells_approach(at, grid, flickers=flickers)
    assert not tells_approach(beyond, grid, flickers=flickers)
