"""A pattern that is matched with another of its repetitions seems to follow the camera."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.wrong_match import note_wrong_matches
from observer.methods.rigid.dense.scene import DenseScene
from observer.types import TrackState
from observer.vision.camera_rate import CameraRate

from ..solid_worlds import CAMERA, GRID, ROOM, patch, points_on, seen
from ..solid_worlds import step_to as now_at
from .judging import P, judge_frames

MakeTrack = Callable[..., BodyTrack]

# m/s: the camera drives ahead.
AHEAD = np.array([0.0, 0.0, 0.4])
# px: a static pattern, and its repetition with which it is matched. Points at the latter seem to
# recede at three quarters of the camera's speed.
TRUE, MATCHED = 8.0, 32.0
PERIOD = round((MATCHED - TRUE) / GRID.reduction)
DEPTH_M = CAMERA.fb / MATCHED
FOLLOWING = tuple((1 - TRUE / MATCHED) * AHEAD)


def pair(period: int | None, true_px: float = TRUE) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Images of a wall at the true disparity, whose texture repeats after so many cells."""
    rng = np.random.default_rng(0)
    height, width = GRID.shape
    shift = round(true_px / GRID.reduction)
    wall = rng.integers(40, 200, (height, width + shift))
    if period is not None:
        wall = np.tile(wall[:, :period], (1, width // period + 2))[:, : width + shift]
    noisy = [
        np.clip(image + rng.normal(0, 2, (height, width)), 0, 255).astype(np.uint8)
        for image in (wall[:, :width], wall[:, shift:])
    ]
    return noisy[0], noisy[1]


def scene_of(images: tuple[NDArray[np.uint8], NDArray[np.uint8]]) -> DenseScene:
    return replace(seen(ROOM), left=images[0], right=images[1])


def noted(track: BodyTrack, scene: DenseScene, camera_mps: NDArray[np.float64] = AHEAD) -> bool:
    """What is noted of a track whose nine points are at the matched disparity."""
    points = points_on(patch(0.0, 0.0, DEPTH_M, 0.1)).but(obstacle=np.full(9, track.id))
    now = replace(now_at(), rate=CameraRate(np.zeros(3), -camera_mps))
    note_wrong_matches([track], points, scene, now)
    return (track.wrong_match or 0.0) > 0.5


def test_a_repetition_that_follows_the_camera_may_stand(make_track: MakeTrack) -> None:
    assert noted(make_track((0.0, 0.0, DEPTH_M), FOLLOWING), scene_of(pair(PERIOD)))


@pytest.mark.parametrize("share", [0.97, 1.0, 1.03])
def test_a_distant_repetition_may_keep_its_distance(make_track: MakeTrack, share: float) -> None:
    """A hedge far away, matched as if it were close by, is carried along by the camera."""
    distant_px = 2.0
    distant = pair(round((MATCHED - distant_px) / GRID.reduction), distant_px)
    for images, may_stand in ((distant, True), (close_by(), False)):
        track = make_track((0.0, 0.0, DEPTH_M), tuple(share * AHEAD))
        assert noted(track, scene_of(images)) is may_stand


@pytest.mark.parametrize("stands", [True, False])
def test_one_frame_does_not_tell_otherwise(make_track: MakeTrack, *, stands: bool) -> None:
    """Noise may make either match the better one for once."""
    usual, other = (pair(PERIOD), close_by()) if stands else (close_by(), pair(PERIOD))
    track = make_track((0.0, 0.0, DEPTH_M), FOLLOWING)
    for _ in range(5):
        assert noted(track, scene_of(usual)) is stands
    found = [noted(track, scene_of(other)) for _ in range(5)]
    assert found[0] is stands
    assert found[-1] is not stands


@pytest.mark.parametrize("matched_px", [4.0, 6.0])
def test_disparities_too_alike_to_be_told_apart_are_not_compared(
    make_track: MakeTrack, matched_px: float
) -> None:
    """A plainly textured thing far away recedes at half the camera's speed."""
    depth_m = CAMERA.fb / matched_px
    track = make_track((0.0, 0.0, depth_m), tuple(0.5 * AHEAD))
    points = points_on(patch(0.0, 0.0, depth_m, 0.3)).but(obstacle=np.full(9, track.id))
    now = replace(now_at(), rate=CameraRate(np.zeros(3), -AHEAD))
    left, right = (
        cv2.GaussianBlur(image, (0, 0), 4).astype(np.uint8) for image in pair(None, matched_px)
    )
    note_wrong_matches([track], points, scene_of((left, right)), now)
    assert track.wrong_match is None


def close_by() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Images of a body that is where it is matched; a wall farther away looks different."""
    left, _ = pair(None)
    return left, np.roll(left, -round(MATCHED / GRID.reduction), axis=1)


def test_a_texture_of_its_own_does_move(make_track: MakeTrack) -> None:
    assert not noted(make_track((0.0, 0.0, DEPTH_M), FOLLOWING), scene_of(close_by()))


@pytest.mark.parametrize(
    "velocity", [(0.3, 0.0, 0.1), (0.0, 0.0, -0.5), (0.0, 0.0, 0.5), (0.0, 0.0, 0.02)]
)
def test_what_moves_otherwise_than_a_wrong_match_would_is_not_compared(
    make_track: MakeTrack, velocity: tuple[float, float, float]
) -> None:
    """It crosses, goes away or stands; a fast approach is never held back."""
    track = make_track((0.0, 0.0, DEPTH_M), velocity)
    track.wrong_match = 1.0
    assert not noted(track, scene_of(pair(PERIOD)))


def test_points_that_cannot_be_compared_say_nothing(make_track: MakeTrack) -> None:
    """Without texture at the other disparity, as beyond the image's border, it counts as moving."""
    track = make_track((0.0, 0.0, DEPTH_M), FOLLOWING)
    track.wrong_match = 1.0
    points = points_on(patch(-0.62 * DEPTH_M, 0.0, DEPTH_M, 0.02)).but(obstacle=np.full(9, 1))
    now = replace(now_at(), rate=CameraRate(np.zeros(3), -AHEAD))
    note_wrong_matches([track], points, scene_of(pair(PERIOD)), now)
    assert not track.wrong_match


def test_a_track_with_limbs_is_not_compared(make_track: MakeTrack) -> None:
    track = make_track((0.0, 0.0, DEPTH_M), FOLLOWING)
    assert noted(track, scene_of(pair(PERIOD)))
    track.rigid = False
    assert not noted(track, scene_of(pair(PERIOD))), "known as a person since"


def test_a_camera_that_stands_shows_nothing_of_it(make_track: MakeTrack) -> None:
    track = make_track((0.0, 0.0, DEPTH_M), FOLLOWING)
    assert not noted(track, scene_of(pair(PERIOD)), np.zeros(3))


def test_a_track_that_is_reported_keeps_its_certainty(make_track: MakeTrack) -> None:
    track = make_track((0.0, 0.0, DEPTH_M), FOLLOWING)
    track.state = TrackState.CONFIRMED
    assert not noted(track, scene_of(pair(PERIOD)))


@pytest.mark.parametrize("wrong", [True, False])
def test_points_that_may_be_matched_wrongly_do_not_confirm(
    make_track: MakeTrack, *, wrong: bool
) -> None:
    track = make_track((0.0, 0.0, 3.0), (0.0, 0.0, 0.5), sigma=0.02)
    track.points, track.wrong_match = 9, float(wrong)
    state = judge_frames(track, 2 * P.confirm_hits)
    assert state is (TrackState.TENTATIVE if wrong else TrackState.CONFIRMED)


@pytest.mark.parametrize("wrong", [True, False])
def test_nor_does_depth_that_is_matched_as_wrongly(
    outlined_track: Callable[..., BodyTrack], *, wrong: bool
) -> None:
    track = outlined_track(arrived=3)
    track.wrong_match = float(wrong)
    track.points = 9
    assert judge_frames(track) is (TrackState.TENTATIVE if wrong else TrackState.CONFIRMED)
    few = outlined_track(arrived=3)
    few.points, few.wrong_match = 2, float(wrong)
    assert judge_frames(few) is TrackState.CONFIRMED, "two points say little of a whole segment"
