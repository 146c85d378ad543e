"""Bodies with limbs are distinguished from rigid ones by their points."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import YAW_RATE
from observer.methods.rigid.bodies.limbs import (
    judge_rigidity,
    may_be_rigid,
    moves_as_one,
    points_show_whole,
)

from ..solid_worlds import Solid, outline_of

MakeTrack = Callable[..., BodyTrack]


def with_outline(
    track: BodyTrack, size: tuple[float, float, float] = (0.45, 1.2, 0.1)
) -> BodyTrack:
    track.outline = outline_of(Solid((0.0, 0.0, 4.0), size))
    return track


@pytest.fixture
def upright(make_track: MakeTrack) -> BodyTrack:
    """Represents a person whose velocity is not known yet."""
    return with_outline(make_track((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), sigma=0.5))


# --- rigid or not --------------------------------------------------------------------------

ALONG, APART = np.ones(20, np.bool_), np.zeros(20, np.bool_)


def after_frames(track: BodyTrack, frames: int, moves_along: NDArray[np.bool_]) -> BodyTrack:
    for _ in range(frames):
        judge_rigidity(track, moves_along)
    return track


def test_a_body_stays_rigid_when_all_points_move_with_it(upright: BodyTrack) -> None:
    assert after_frames(upright, 100, ALONG).rigid
    assert upright.rigidity == pytest.approx(1.0)


def test_a_body_stays_rigid_when_most_points_move_with_it(upright: BodyTrack) -> None:
    most = ALONG.copy()
    most[:3] = False
    assert after_frames(upright, 100, most).rigid


def test_an_upright_body_with_independently_moving_points_has_limbs(upright: BodyTrack) -> None:
    upright.filter.means[:, YAW_RATE] = 0.4
    assert after_frames(upright, 1, APART).rigid
    assert not after_frames(upright, 4, APART).rigid
    assert upright.yaw_rate == 0.0


@pytest.mark.parametrize(("points", "steady_s", "rigid"), [(12, 0.5, True), (11, 0.5, False),
                                                           (12, 0.4, False)])  # fmt: skip
def test_many_steadily_driving_points_do_not_belong_to_a_limb(
    upright: BodyTrack, points: int, steady_s: float, rigid: bool
) -> None:
    """A robot's base, below a mast with only a few wrongly tracked points."""
    upright.by_points, upright.points, upright.steady_s = True, points, steady_s
    assert after_frames(upright, 20, APART).rigid is rigid


def test_an_upright_body_becomes_rigid_only_after_steady_driving(upright: BodyTrack) -> None:
    """A lying thing is, as soon as a group of points on it moves."""
    velocity = np.array([0.3, 0.0, 0.0])
    assert not may_be_rigid(upright), "it is already"
    upright.loosen()
    assert may_be_rigid(upright)
    results = []
    for upright.age_s in (0.0, 0.3, 0.6):
        results.append(moves_as_one(upright, velocity, 12))
    assert results == [False, False, True]
    assert upright.outline is not None
    upright.outline.depths.measured = True
    assert not may_be_rigid(upright), "points on its trunk tell how it moves"


def test_a_lying_body_becomes_rigid_once_a_group_of_its_points_moves(make_track: MakeTrack) -> None:
    track = with_outline(make_track(), size=(0.8, 0.4, 0.1))
    track.loosen()
    assert may_be_rigid(track)
    assert moves_as_one(track, np.array([0.3, 0.0, 0.0]), 3)


def test_legs_cut_off_by_the_border_are_not_rigid(make_track: MakeTrack) -> None:
    """However wide they are: a few points on one shin move as one."""
    track = with_outline(make_track(), size=(0.8, 0.4, 0.1))
    track.loosen()
    assert track.outline is not None
    track.outline.legs_seen = True
    assert not moves_as_one(track, np.array([0.3, 0.0, 0.0]), 3)
    track.outline.depths.measured = True
    assert not may_be_rigid(track)


def test_a_body_with_limbs_keeps_them(upright: BodyTrack) -> None:
    after_frames(upright, 10, APART)
    assert not after_frames(upright, 100, ALONG).rigid


def test_a_lying_body_is_rigid_whatever_its_points_do(make_track: MakeTrack) -> None:
    track = with_outline(make_track(), size=(0.8, 0.4, 0.1))
    assert after_frames(track, 50, APART).rigid


def shown_over(track: BodyTrack, height: float, width: float, points: int = 20) -> BodyTrack:
    """The track, with its points spread over these shares of its outline."""
    assert track.outline is not None
    u0, v0, u1, v1 = track.outline.box_px
    track.box_px = (u0, v0, u0 + width * (u1 - u0), v0 + height * (v1 - v0))
    track.points = points
    return track


def test_points_all_over_an_outline_show_the_whole_body(upright: BodyTrack) -> None:
    assert points_show_whole(shown_over(upright, 0.9, 0.9), upright.outline)


@pytest.mark.parametrize(
    ("height", "width", "points"), [(0.4, 0.9, 20), (0.9, 0.3, 20), (0.9, 0.9, 5)]
)
def test_few_points_or_points_on_a_part_do_not_show_the_whole_body(
    upright: BodyTrack, height: float, width: float, points: int
) -> None:
    assert not points_show_whole(shown_over(upright, height, width, points), upright.outline)


def test_points_never_show_the_whole_of_a_body_with_limbs(upright: BodyTrack) -> None:
    upright.loosen()
    assert not points_show_whole(shown_over(upright, 1.0, 1.0), upright.outline)


def test_a_body_with_few_points_stays_rigid_only_while_they_show_it_whole(
    make_track: MakeTrack,
) -> None:
    few = np.ones(2, np.bool_)
    for height, rigid in ((1.0, True), (0.3, False)):
        track = shown_over(with_outline(make_track()), height, 1.0)
        assert after_frames(track, 10, few).rigid is rigid
