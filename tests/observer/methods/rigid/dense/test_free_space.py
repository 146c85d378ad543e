"""Evidence of motion from depth, for worlds whose every change is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.geometry import Pose
from observer.methods.rigid.dense.free_space import (
    ARRIVED,
    STATIC,
    UNCOVERED,
    UNKNOWN,
    DepthFrame,
    FreeSpace,
)

from ..solid_worlds import (
    CAMERA,
    FLOOR,
    GRID,
    HERE,
    ROOM,
    Shape,
    Solid,
    cells_of,
    disparity_of,
    on_floor,
    person,
)

quick = settings(max_examples=10)
ALL = np.ones(GRID.shape, np.bool_)
CRATE = on_floor(-1.0, 4.0, (0.6, 0.8, 0.5), 0.3)
small = st.floats(-0.3, 0.3)


def frame(time: float, shapes: Sequence[Shape], T_world_camera: Pose = HERE) -> DepthFrame:
    return DepthFrame(time, disparity_of(shapes, T_world_camera), T_world_camera.inverse())


def evidence(now: DepthFrame, *before: DepthFrame) -> np.ndarray:
    space = FreeSpace(GRID)
    for each in before:
        space.keep(each)
    return space.evidence(now, ALL)


def inner(mask: np.ndarray, by: int = 3) -> np.ndarray:
    """(h, w) the cells of a mask away from its border."""
    padded = np.pad(mask, by)
    out = mask.copy()
    for row in range(2 * by + 1):
        for column in range(2 * by + 1):
            out &= padded[row : row + GRID.height, column : column + GRID.width]
    return out


@st.composite
def motions(draw: st.DrawFn) -> Pose:
    turn = [draw(small) * 0.5, draw(small), draw(small) * 0.3]
    return Pose.from_rotvec(turn, [draw(small), draw(small), draw(small) * 2])


@quick
@given(moved=motions())
def test_a_static_scene_is_static_wherever_it_was_seen_before(moved: Pose) -> None:
    """For any camera motion: a floor and a wall that hide nothing."""
    now, before = frame(0.4, ROOM, moved), frame(0.0, ROOM)
    found = evidence(now, before)
    cells = np.indices(GRID.shape, np.float64)[::-1].transpose(1, 2, 0)
    place = moved.apply(CAMERA.triangulate(GRID.to_px(cells), now.disparity))
    px, _ = CAMERA.project(place)
    at = GRID.to_cells(px)
    inside = ((at >= 0) & (at <= [GRID.width - 1, GRID.height - 1])).all(axis=-1)
    outside = ((at < -1) | (at > [GRID.width, GRID.height])).any(axis=-1)
    assert (found[inside] == STATIC).all()
    assert (found[outside] == UNKNOWN).all()
    assert set(np.unique(found)) <= {STATIC, UNKNOWN}


@quick
@given(moved=motions(), yaw=st.floats(-1, 1))
def test_static_objects_hiding_each_other_never_arrive(moved: Pose, yaw: float) -> None:
    world = [*ROOM, on_floor(-0.6, 3.0, (0.5, 1.2, 0.5), yaw), on_floor(0.8, 5.0, (0.8, 0.6, 0.4))]
    found = evidence(frame(0.4, world, moved), frame(0.0, world))
    assert (found == ARRIVED).mean() < 1e-4


@quick
@given(moved=motions(), x=st.floats(-0.5, 0.8), z=st.floats(2.5, 5))
def test_an_object_entering_free_space_has_arrived_for_any_camera_motion(
    moved: Pose, x: float, z: float
) -> None:
    # It floats: a foot on the floor would be no nearer than the floor itself.
    newcomer = Solid((x, -0.1, z), (0.45, 1.0, 0.25))
    found = evidence(frame(0.4, [*ROOM, newcomer], moved), frame(0.0, ROOM))
    on = inner(cells_of(newcomer, [*ROOM, newcomer], moved)) & (found != UNKNOWN)
    assert (found[on] == ARRIVED).all()


def test_background_left_behind_by_an_object_is_uncovered() -> None:
    newcomer = person(0.5, 3.0)
    found = evidence(frame(0.4, ROOM), frame(0.0, [*ROOM, newcomer]))
    on = inner(cells_of(newcomer, [*ROOM, newcomer]))
    upper = on & (np.arange(GRID.height)[:, None] < GRID.height // 2 + 20)
    assert (found[upper] == UNCOVERED).all()
    assert (found[~cells_of(newcomer, [*ROOM, newcomer])] == STATIC).all()


def test_a_static_object_beside_an_arriving_one_stays_static() -> None:
    before, now = [*ROOM, CRATE], [*ROOM, CRATE, person(0.5, 4.0)]
    found = evidence(frame(0.4, now), frame(0.0, before))
    assert (found[cells_of(CRATE, now)] == STATIC).all()


def test_a_receding_object_is_uncovered_and_an_approaching_one_has_arrived() -> None:
    near, far = person(0.0, 3.0), person(0.0, 3.6)
    on = inner(cells_of(far, [far])) & (np.arange(GRID.height)[:, None] < 110)
    assert (evidence(frame(0.4, [far]), frame(0.0, [near]))[on] == UNCOVERED).all()
    assert (evidence(frame(0.4, [near, FLOOR]), frame(0.0, [far, FLOOR]))[on] == ARRIVED).all()


def test_a_difference_within_the_noise_is_static() -> None:
    before, now = frame(0.0, ROOM), frame(0.4, ROOM)
    noise = np.random.default_rng(0).uniform(-0.6, 0.6, GRID.shape).astype(np.float32)
    found = evidence(DepthFrame(0.4, now.disparity + noise, now.T_camera_world), before)
    assert (found == STATIC).all()


# --- what is unknown -----------------------------------------------------------------------


def test_the_first_frame_gives_no_evidence() -> None:
    assert (evidence(frame(0.0, ROOM)) == UNKNOWN).all()


def test_cells_not_measured_before_are_unknown() -> None:
    before = disparity_of(ROOM)
    before[:, :100] = np.nan
    found = evidence(frame(0.4, [*ROOM, person(-1.2, 4.0)]), DepthFrame(0.0, before, HERE))
    assert (found[:, :100] == UNKNOWN).all()
    assert (found[:, 110:] == STATIC).all()


def test_cells_not_measured_now_are_unknown() -> None:
    now = disparity_of(ROOM)
    now[:90] = np.nan
    asked = np.isfinite(now)
    space = FreeSpace(GRID)
    space.keep(frame(0.0, ROOM))
    found = space.evidence(DepthFrame(0.4, now, HERE), asked)
    np.testing.assert_array_equal(found == UNKNOWN, ~asked)


def test_only_the_requested_cells_are_judged() -> None:
    space = FreeSpace(GRID)
    space.keep(frame(0.0, ROOM))
    asked = np.zeros(GRID.shape, np.bool_)
    asked[50:60, 70:90] = True
    found = space.evidence(frame(0.4, ROOM), asked)
    np.testing.assert_array_equal(found == STATIC, asked)


def test_cells_that_were_behind_the_camera_are_unknown() -> None:
    back = Pose.from_rotvec([0.0, np.pi, 0.0], np.zeros(3))
    assert (evidence(frame(0.4, ROOM), frame(0.0, ROOM, back)) == UNKNOWN).all()


# --- which of the earlier frames decides ---------------------------------------------------


@pytest.mark.parametrize("stood_s", [0.3, 1.0, 3.0])
def test_a_person_who_stopped_recently_has_still_arrived(stood_s: float) -> None:
    newcomer = person(0.5, 4.0)
    times = np.arange(0.0, 3.3, 0.1)
    came = times[-1] - stood_s
    frames = [frame(t, [*ROOM, newcomer] if t > came else ROOM) for t in times]
    found = evidence(frame(3.3, [*ROOM, newcomer]), *frames)
    on = inner(cells_of(newcomer, [*ROOM, newcomer])) & (np.arange(GRID.height)[:, None] < 110)
    assert (found[on] == ARRIVED).all()


def test_a_person_standing_longer_than_the_memory_is_static() -> None:
    newcomer = person(0.5, 4.0)
    world = [*ROOM, newcomer]
    frames = [frame(t, world if t > 0.5 else ROOM) for t in np.arange(0.0, 5.5, 0.1)]
    found = evidence(frame(5.5, world), *frames)
    assert (found[cells_of(newcomer, world)] == STATIC).all()


def test_a_newer_frame_decides_where_the_oldest_saw_nothing() -> None:
    aside = Pose.from_rotvec([0.0, -0.4, 0.0], np.zeros(3))
    newcomer = person(1.2, 4.0)
    world = [*ROOM, newcomer]
    old, young, now = frame(0.0, ROOM, aside), frame(2.4, ROOM), frame(3.2, world)
    on = inner(cells_of(newcomer, world)) & (np.arange(GRID.height)[:, None] < 110)
    assert (evidence(now, old)[on] == UNKNOWN).all()
    assert (evidence(now, old, young)[on] == ARRIVED).all()


def test_frames_outside_the_compared_lags_are_ignored() -> None:
    """Neither very recent frames nor very old ones."""
    for age in (0.02, 0.1, 6.0):
        assert (evidence(frame(7.0, ROOM), frame(7.0 - age, ROOM)) == UNKNOWN).all()


def test_frames_older_than_any_lag_are_discarded() -> None:
    space = FreeSpace(GRID)
    known = frame(0.0, ROOM)
    for k in range(200):
        space.keep(DepthFrame(k * 0.1, known.disparity, known.T_camera_world))
    assert len(space._frames) < 50
