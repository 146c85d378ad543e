"""Surfaces around the robot: where they are, how long they count, and what is not a surface."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.geometry import Float64Array
from observer.guard.sight import FreeScan, SeenObstacle
from observer.navigation.local_map import CELL_M, LocalMap
from observer.occupancy import BLOCKED, FREE, UNKNOWN
from observer.robots.contract import SonarReading

HERE = np.zeros(3)
BEARINGS = np.radians(np.arange(-30.0, 30.1, 3.0))


def wall(ahead_m: float | None, to_m: float = 4.0) -> FreeScan:
    """Return a scan of a wall across the view, or of free ground up to ``to_m``."""
    far = [None if ahead_m is None else ahead_m / math.cos(each) for each in BEARINGS]
    return FreeScan(
        tuple(BEARINGS.tolist()),
        tuple(far),
        (0.8,) * len(far),
        tuple(to_m if each is None else each for each in far),
    )


def person(x: float, y: float) -> SeenObstacle:
    return SeenObstacle(1, x, y, 0.0, 0.0, 0.3, 0.05, 0.1, False)


def look(local: LocalMap, scan: FreeScan, *tracks: SeenObstacle, pose: Float64Array = HERE) -> None:
    """Feed the map this view until time 0, long enough to count as static."""
    for k in range(-7, 1):
        local.see(scan, tracks, pose, 0.1 * k)


def clearance(local: LocalMap, x: float, y: float, time: float = 0.1) -> float:
    return float(local.clearance(np.array([x, y]), time))


@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.0), (2.3, -1.1, 2.0), (-7.0, 40.0, -3.0)])
def test_a_wall_is_where_it_was_seen(pose: tuple[float, float, float]) -> None:
    local = LocalMap()
    local.move_to(pose[0], pose[1])
    look(local, wall(2.0), pose=np.array(pose))
    ahead = np.array([math.cos(pose[2]), math.sin(pose[2])])
    for distance in (0.5, 1.0, 1.5):
        x, y = np.array(pose[:2]) + distance * ahead
        assert clearance(local, x, y) == pytest.approx(2.0 - distance, abs=1.5 * CELL_M)
    # Behind the wall nothing is known, so nothing is blocked.
    assert local.blocked(0.1).sum() < 60


def test_cells_seen_free_are_unblocked() -> None:
    local = LocalMap()
    look(local, wall(2.0))
    assert local.blocked(0.1).any()
    local.see(wall(None), (), HERE, 0.1)
    # The last cell at the border of the view may stay.
    assert local.blocked(0.1).sum() <= 2
    assert clearance(local, 2.0, 0.0) > 0.9


def test_a_static_surface_expires() -> None:
    local = LocalMap()
    look(local, wall(2.0))
    assert local.blocked(9.9).any()
    assert not local.blocked(10.1).any()


def test_a_briefly_seen_object_leaves_no_surface_behind() -> None:
    local = LocalMap()
    for k in range(8):
        # An untracked person walks past, 0.15 m per frame.
        local.see(wall(2.0 + 0.15 * k), (), HERE, 0.1 * k)
        assert not local.blocked(0.1 * k).any()


def test_a_tracked_obstacle_leaves_no_surface_behind() -> None:
    scan = wall(2.0)
    alone = FreeScan(
        scan.bearings,
        tuple(
            far if abs(b) < 0.1 else None for b, far in zip(BEARINGS, scan.blocked_m, strict=True)
        ),
        scan.known_from_m,
        scan.known_to_m,
    )
    local = LocalMap()
    look(local, alone, person(2.2, 0.0))
    assert not local.blocked(0.1).any()
    look(local, alone, person(3.5, 0.0))
    assert local.blocked(0.1).any()


def test_the_map_follows_the_robot() -> None:
    local = LocalMap()
    look(local, wall(2.0))
    local.move_to(1.0, 0.5)
    assert clearance(local, 1.0, 0.0) == pytest.approx(1.0, abs=1.5 * CELL_M)
    local.move_to(-100.0, 0.0)
    assert not local.blocked(0.1).any()
    local.move_to(0.0, 0.0)
    assert not local.blocked(0.1).any()


def test_repeated_near_echoes_block_their_cell_for_about_a_second() -> None:
    readings = [
        SonarReading(0, 0.1, 0.0, 0.0, 0.9, 5.0),
        SonarReading(1, 0.0, 0.1, math.pi / 2, 2.5, 5.0),
        SonarReading(2, 0.0, -0.1, -math.pi / 2, None, 5.0),
    ]
    local, stood = LocalMap(), np.zeros((len(readings), 3))
    local.hear(readings, stood, HERE)
    assert not local.blocked(5.1).any()
    for k in range(8):
        local.hear([replace(each, received=5.0 + 0.1 * k) for each in readings], stood, HERE)
    assert local.blocked(6.6).sum() == 1
    assert clearance(local, 0.5, 0.0, 6.6) == pytest.approx(0.5, abs=1.5 * CELL_M)
    assert not local.blocked(6.8).any()


@given(
    st.lists(st.floats(-1e4, 1e4), min_size=3, max_size=3),
    st.lists(st.floats(-1e4, 1e4), min_size=3, max_size=3),
    st.floats(0.0, 20.0),
)
def test_clearance_is_finite_for_any_pose(
    first: list[float], second: list[float], far: float
) -> None:
    local = LocalMap()
    for pose in (first, second):
        local.move_to(pose[0], pose[1])
        look(local, wall(far), pose=np.array(pose))
        reach = local.clearance(np.array([pose[:2], [0.0, 0.0]]), 0.1)
        assert np.isfinite(reach).all()
        assert (reach >= 0).all()


def state(local: LocalMap, x: float, y: float, time: float = 0.1) -> int:
    at = np.floor((np.array([x, y]) - snapshot_corner(local)) / CELL_M).astype(int)
    return int(local.snapshot(HERE, time).cells()[at[0], at[1]])


def snapshot_corner(local: LocalMap) -> Float64Array:
    made = local.snapshot(HERE, 0.1)
    return np.array([made.x, made.y])


def test_free_ground_is_distinguished_from_unseen_ground() -> None:
    local = LocalMap()
    look(local, wall(2.0))
    assert state(local, 1.25, 0.05) == FREE
    assert state(local, 2.05, 0.05) == BLOCKED
    # Nearer than the cameras see, behind the wall, and behind the robot.
    assert {state(local, x, 0.05) for x in (0.45, 2.65, -1.05)} == {UNKNOWN}
    assert local.snapshot(np.array([0.2, -0.1, 0.5]), 0.1).robot == (0.2, -0.1, 0.5)


def test_free_ground_expires_with_age() -> None:
    local = LocalMap()
    local.see(wall(None), (), HERE, 0.0)
    assert state(local, 2.0, 0.05, 9.9) == FREE
    assert state(local, 2.0, 0.05, 10.1) == UNKNOWN


def test_newly_occupied_ground_is_unknown_until_the_object_is_static() -> None:
    local = LocalMap()
    local.see(wall(None), (), HERE, -1.0)
    local.see(wall(2.0), (), HERE, -0.7)
    assert state(local, 2.05, 0.05, -0.7) == UNKNOWN
    look(local, wall(2.0))
    assert state(local, 2.05, 0.05) == BLOCKED
    # The wall is gone.
    local.see(wall(None), (), HERE, 0.2)
    assert state(local, 2.05, 0.05, 0.2) == FREE


@given(st.floats(-30.0, 30.0), st.floats(-30.0, 30.0))
def test_known_cells_stay_in_place_while_the_robot_drives(x: float, y: float) -> None:
    local = LocalMap()
    local.move_to(x, y)
    look(local, wall(2.0), pose=np.array([x, y, 0.0]))
    before, corner = local.snapshot(HERE, 0.1), snapshot_corner(local)
    local.move_to(x + 0.7, y - 0.4)
    shift = np.round((snapshot_corner(local) - corner) / CELL_M).astype(int)
    after = local.snapshot(HERE, 0.1)
    # Nothing is near the edge, so no cell wraps around.
    moved = np.roll(before.cells(), -shift, axis=(0, 1))
    np.testing.assert_array_equal(after.cells(), moved)
