"""When a body is confirmed, by its outline or by its points."""

from __future__ import annotations

from dataclasses import replace

import pytest

from observer.methods.rigid.bodies.image_growth import Growth
from observer.methods.rigid.dense.free_space import ARRIVED, STATIC
from observer.methods.rigid.dense.grey_change import Light
from observer.types import MotionState, TrackState

from .judging import STEADY, STOOD, MakeTrack, P, judge_frames

AWAY = (0.2, 0.0, 0.5)


def test_a_body_entering_free_space_is_confirmed_without_points(
    outlined_track: MakeTrack,
) -> None:
    assert judge_frames(outlined_track(arrived=3)) is TrackState.CONFIRMED


def test_too_few_frames_of_evidence_do_not_confirm(outlined_track: MakeTrack) -> None:
    assert judge_frames(outlined_track(arrived=2, uncovered=3), 20) is TrackState.TENTATIVE


@pytest.mark.parametrize("against", ["wall", "before"])
@pytest.mark.parametrize(
    ("height", "state"), [(0.5, TrackState.TENTATIVE), (1.2, TrackState.CONFIRMED)]
)
def test_a_patch_of_noise_on_a_static_surface_is_not_confirmed(
    outlined_track: MakeTrack, against: str, height: float, state: TrackState
) -> None:
    """A patch the height of a body part may belong to a wall, or have been there before."""
    track = outlined_track(arrived=3, height=height)
    segment = track.outline.segment
    on_wall = replace(segment, clear=0.0)
    track.outline.segment = on_wall if against == "wall" else replace(segment, static=0.9)
    assert judge_frames(track) is state


@pytest.mark.parametrize(
    ("height", "state"), [(0.5, TrackState.TENTATIVE), (1.2, TrackState.CONFIRMED)]
)
@pytest.mark.parametrize("side", [0, 1])
def test_a_patch_beside_a_nearer_person_is_not_confirmed(
    outlined_track: MakeTrack, side: int, height: float, state: TrackState
) -> None:
    """Only one camera sees that region; a person who passes behind is taller."""
    track = outlined_track(arrived=3, height=height)
    cut = (side == 0, side == 1, False, False)
    track.outline.segment = replace(track.outline.segment, cut=cut)
    assert judge_frames(track) is state


@pytest.mark.parametrize(
    ("height", "points", "state"),
    [
        (0.5, 0, TrackState.TENTATIVE),
        (0.5, 3, TrackState.CONFIRMED),
        (1.2, 0, TrackState.CONFIRMED),
    ],
)
def test_a_hanging_patch_without_points_is_not_confirmed(
    outlined_track: MakeTrack, height: float, points: int, state: TrackState
) -> None:
    """Where a pattern repeats itself, depth appears and disappears, and nothing is tracked."""
    track = outlined_track(arrived=3, height=height)
    track.outline.hangs, track.points = True, points
    assert judge_frames(track) is state


def test_a_waving_person_is_confirmed_only_as_a_separate_body(outlined_track: MakeTrack) -> None:
    """A flicker on a wall is not."""
    for clear, state in ((1.0, TrackState.CONFIRMED), (0.0, TrackState.TENTATIVE)):
        track = outlined_track(STOOD)
        track.outline.segment = replace(track.outline.segment, apart=1.0, clear=clear)
        for k in range(30):
            track.changes.note(0.1 * k, changed=k % 3 < 2)
        assert judge_frames(track) is state
        assert track.motion is MotionState.IN_PLACE


def test_an_emerging_body_needs_more_frames_and_a_more_certain_velocity(
    outlined_track: MakeTrack,
) -> None:
    """A velocity of 3.9 standard deviations is too little; one of more than 16 suffices."""
    for sigma, state in ((0.13, TrackState.TENTATIVE), (0.03, TrackState.CONFIRMED)):
        assert judge_frames(outlined_track(AWAY, uncovered=4, sigma=sigma)) is state
    assert judge_frames(outlined_track(arrived=3, sigma=0.13)) is TrackState.CONFIRMED


def test_what_recedes_faster_than_anyone_runs_is_not_confirmed(outlined_track: MakeTrack) -> None:
    """The depth of a plain wall beside something nearer may change from frame to frame."""
    for speed, state in ((2.5, TrackState.CONFIRMED), (3.5, TrackState.TENTATIVE)):
        assert judge_frames(outlined_track((0.0, 0.0, speed), uncovered=4)) is state


def test_background_uncovered_by_others_is_not_confirmed(
    outlined_track: MakeTrack,
) -> None:
    for velocity in ((0.5, 0.0, 0.0), (0.5, 0.0, 0.4), (0.0, 0.0, -0.5)):
        assert judge_frames(outlined_track(velocity, uncovered=50), 20) is TrackState.TENTATIVE


def test_an_outline_confirms_only_while_it_moves(outlined_track: MakeTrack) -> None:
    for velocity in (STOOD, (P.stopped_below_mps / 2, 0.0, 0.0)):
        # However certain it is that it creeps.
        track = outlined_track(velocity, arrived=50, uncovered=50, sigma=1e-3)
        assert judge_frames(track, 20) is TrackState.TENTATIVE
        assert track.motion is MotionState.STOPPED


def test_a_very_uncertain_velocity_does_not_confirm(outlined_track: MakeTrack) -> None:
    assert judge_frames(outlined_track(arrived=10, sigma=0.4), 20) is TrackState.TENTATIVE


def test_an_outline_confirms_only_while_it_is_seen(outlined_track: MakeTrack) -> None:
    track = outlined_track(arrived=10)
    track.outline.seen = False
    assert judge_frames(track) is TrackState.TENTATIVE
    track.outline.seen, track.missed_s = True, 0.1
    assert judge_frames(track) is TrackState.TENTATIVE


def test_a_confirmed_body_stays_confirmed_when_it_stops(outlined_track: MakeTrack) -> None:
    track = outlined_track(arrived=3)
    judge_frames(track)
    track.filter = outlined_track(STOOD).filter
    assert judge_frames(track) is TrackState.CONFIRMED
    assert track.motion is MotionState.STOPPED


def test_points_of_a_body_merged_with_its_surroundings_do_not_confirm(
    make_track: MakeTrack,
) -> None:
    """Unless they are many and stand above the ground: reflections lie below it."""
    for points, merged_s, off_ground, state in (
        (11, 0.1, True, TrackState.TENTATIVE),
        (11, 0.0, True, TrackState.CONFIRMED),
        (20, 0.1, True, TrackState.CONFIRMED),
        (20, 0.1, False, TrackState.TENTATIVE),
    ):
        track = make_track()
        track.points, track.merged_s, track.off_ground = points, merged_s, off_ground
        assert judge_frames(track, P.confirm_hits + 5) is state


@pytest.mark.parametrize(
    ("lies", "state"), [(False, TrackState.CONFIRMED), (True, TrackState.TENTATIVE)]
)
def test_far_points_on_the_ground_do_not_confirm(
    make_track: MakeTrack, lies: bool, state: TrackState
) -> None:
    track = make_track((0.0, 0.0, 4.0), (0.5, 0.0, 0.0))
    track.points, track.merged_s, track.far, track.lies = 9, 0.1, True, lies
    assert judge_frames(track, P.confirm_hits + 5) is state


def test_a_few_creeping_points_without_an_outline_do_not_confirm(make_track: MakeTrack) -> None:
    """Where the legs of two chairs cross in the image, points slide along."""
    for points, speed, state in (
        (5, 0.12, TrackState.TENTATIVE),
        (5, 0.25, TrackState.CONFIRMED),
        (8, 0.12, TrackState.CONFIRMED),
    ):
        track = make_track((0.0, 0.0, 4.0), (speed, 0.0, 0.0), sigma=0.01)
        track.points = points
        assert judge_frames(track, P.confirm_hits + 5) is state


@pytest.mark.parametrize(
    ("velocity", "crosses"),
    [((0.5, 0.0, 0.1), True), ((0.1, 0.0, -0.5), False), ((0.12, 0.0, 0.0), False)],
)
def test_points_of_a_merged_body_may_certainly_cross_the_view(
    make_track: MakeTrack, velocity: tuple[float, float, float], crosses: bool
) -> None:
    """They do not confirm it; and one that comes straight on or creeps may be a static edge."""
    track = make_track((0.0, 0.0, 4.0), velocity)
    track.points, track.merged_s = 9, 0.1
    judge_frames(track)
    assert not track.crosses, "one frame is not enough"
    assert judge_frames(track, P.confirm_hits) is TrackState.TENTATIVE
    assert track.crosses is crosses


@pytest.mark.parametrize(
    ("velocity", "state"),
    [((0.5, 0.0, 0.1), TrackState.CONFIRMED), ((0.1, 0.0, -0.5), TrackState.TENTATIVE)],
)
def test_points_beyond_segment_range_confirm_only_a_body_crossing_the_view(
    make_track: MakeTrack, velocity: tuple[float, float, float], state: TrackState
) -> None:
    for merged_s in (0.0, 0.1):
        track = make_track((0.0, 0.0, 9.0), velocity)
        track.points, track.merged_s, track.far = 20, merged_s, True
        assert judge_frames(track, P.confirm_hits + 5) is state


@pytest.mark.parametrize(
    ("beyond", "state"),
    [(0.3, TrackState.CONFIRMED), (0.12, TrackState.TENTATIVE), (-0.3, TrackState.TENTATIVE)],
)
def test_a_far_body_that_approaches_is_confirmed_by_the_growth_of_its_image(
    make_track: MakeTrack, beyond: float, state: TrackState
) -> None:
    """The image of a static one would have grown by 0.1, as the camera drives on."""
    track = make_track((0.0, 0.0, 9.0), (0.1, 0.0, -0.8))
    track.points, track.far = 20, True
    track.growth = Growth(beyond, 1e-4, 0.1)
    assert judge_frames(track, P.confirm_hits + 5) is state


@pytest.mark.parametrize(
    ("velocity", "state"),
    [((0.0, 0.0, 0.5), TrackState.TENTATIVE), ((0.5, 0.0, 0.0), TrackState.CONFIRMED)],
)
def test_points_on_a_post_confirm_only_a_body_crossing_the_view(
    make_track: MakeTrack, velocity: tuple[float, float, float], state: TrackState
) -> None:
    """Matched together with the wall behind it, a narrow post seems to recede."""
    track = make_track((0.0, 0.0, 6.0), velocity)
    track.points, track.box_px = 20, (300.0, 20.0, 312.0, 200.0)
    assert judge_frames(track, P.confirm_hits + 5) is state


def test_slow_points_in_formerly_filled_space_do_not_confirm(
    outlined_track: MakeTrack,
) -> None:
    """A highlight on a chair while the light changes, or a slow robot."""
    for speed, evidence, state in (
        (0.1, STATIC, TrackState.TENTATIVE),
        (0.25, STATIC, TrackState.CONFIRMED),
        (0.1, ARRIVED, TrackState.CONFIRMED),
    ):
        track = outlined_track((speed, 0.0, 0.0), sigma=0.005, evidence=evidence)
        track.points = 12
        assert judge_frames(track, 5) is state


@pytest.mark.parametrize(
    ("velocity", "evidence", "rigid", "state"),
    [
        ((0.7, 0.0, -0.7), STATIC, False, TrackState.TENTATIVE),
        ((0.0, 0.0, -0.7), STATIC, False, TrackState.CONFIRMED),
        ((0.7, 0.0, -0.7), ARRIVED, False, TrackState.CONFIRMED),
        ((0.7, 0.0, -0.7), STATIC, True, TrackState.CONFIRMED),
    ],
)
def test_limb_points_crossing_static_surfaces_do_not_confirm(
    outlined_track: MakeTrack,
    velocity: tuple[float, float, float],
    evidence: int,
    rigid: bool,
    state: TrackState,
) -> None:
    """Somebody coming along the line of sight may stay in formerly filled space for a while."""
    track = outlined_track(velocity, evidence=evidence)
    track.points, track.rigid = 16, rigid
    assert judge_frames(track, 5) is state


@pytest.mark.parametrize(
    ("velocity", "evidence", "state"),
    [
        ((0.0, 0.0, -0.25), STATIC, TrackState.TENTATIVE),
        ((0.0, 0.0, 0.25), STATIC, TrackState.TENTATIVE),
        ((0.2, 0.0, -0.2), STATIC, TrackState.CONFIRMED),
        ((0.0, 0.0, -0.6), STATIC, TrackState.CONFIRMED),
        ((0.0, 0.0, -0.25), ARRIVED, TrackState.CONFIRMED),
    ],
)
def test_flickering_light_prevents_confirmation_of_approach_or_retreat(
    outlined_track: MakeTrack,
    velocity: tuple[float, float, float],
    evidence: int,
    state: TrackState,
) -> None:
    """Unless it is fast, moves across the view, or enters free space."""
    for light, expected in ((STEADY, TrackState.CONFIRMED), (Light(flickers=True), state)):
        track = outlined_track(velocity, sigma=0.005, evidence=evidence)
        track.points = 12
        assert judge_frames(track, 5, light=light) is expected


def test_swinging_exposure_requires_more_evidence_of_entering_free_space(
    outlined_track: MakeTrack,
) -> None:
    """A saturated region changes its depth when it is no longer saturated."""
    swings = Light(swings=True)
    certain, uncertain = 0.02, 0.12
    for arrived, sigma, expected in (
        (3, certain, TrackState.TENTATIVE),
        (6, uncertain, TrackState.TENTATIVE),
        (6, certain, TrackState.CONFIRMED),
    ):
        assert judge_frames(outlined_track(arrived=arrived, sigma=sigma), light=swings) is expected
        assert judge_frames(outlined_track(arrived=arrived, sigma=sigma)) is TrackState.CONFIRMED


@pytest.mark.parametrize("why", ["part_moves", "loosened"])
def test_moving_parts_or_points_allow_confirmation_by_a_less_certain_velocity(
    outlined_track: MakeTrack, why: str
) -> None:
    """4 standard deviations suffice; 2.5, hardly more than a waving person may show, do not."""
    for speed, known, state in (
        (0.8, True, TrackState.CONFIRMED),
        (0.8, False, TrackState.TENTATIVE),
        (0.5, True, TrackState.TENTATIVE),
    ):
        track = outlined_track((0.0, 0.0, -speed), sigma=0.2, evidence=STATIC)
        setattr(track, why, known)
        track.points = 12
        assert judge_frames(track, 5) is state
