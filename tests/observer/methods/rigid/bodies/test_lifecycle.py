"""When a body that is seen as an outline is confirmed, and when it ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import BodyFilter
from observer.methods.rigid.bodies.lifecycle import is_over, judge
from observer.methods.rigid.dense.free_space import ARRIVED, STATIC
from observer.methods.rigid.dense.grey_change import Light
from observer.parameters import Parameters
from observer.types import MotionState, TrackState

from ..solid_worlds import Solid, outline_of

P = Parameters().obstacles
MakeTrack = Callable[..., BodyTrack]
STOOD, AWAY = (0.0, 0.0, 0.0), (0.2, 0.0, 0.5)
STEADY = Light()
PLACE = np.array([0.0, 0.0, 4.0])
DT = 0.1


@pytest.fixture
def guest(make_track: MakeTrack) -> Callable[..., BodyTrack]:
    """Gives a tentative track with an outline: after frames of either kind of evidence."""

    def make(
        velocity: tuple[float, float, float] = (0.5, 0.0, 0.0),
        *,
        arrived: int = 0,
        hidden: int = 0,
        sigma: float = 0.03,
        evidence: int = ARRIVED,
        height: float = 1.2,
    ) -> BodyTrack:
        track = make_track((0.0, 0.0, 4.0), velocity, sigma=sigma)
        track.outline = outline_of(Solid((0.0, 0.0, 4.0), (0.45, height, 0.1)), evidence)
        track.outline.arrived_frames, track.outline.hidden_frames = arrived, hidden
        return track

    return make


def judged(track: BodyTrack, frames: int = 1, *, light: Light = STEADY) -> TrackState:
    for _ in range(frames):
        judge(track, np.zeros(3), DT, P, light=light)
    return track.state


def test_who_enters_free_space_is_confirmed_without_any_point(guest: MakeTrack) -> None:
    assert judged(guest(arrived=3)) is TrackState.CONFIRMED


def test_too_few_frames_of_evidence_confirm_nobody(guest: MakeTrack) -> None:
    assert judged(guest(arrived=2, hidden=3), 20) is TrackState.TENTATIVE


@pytest.mark.parametrize("against", ["wall", "before"])
@pytest.mark.parametrize(
    ("height", "state"), [(0.5, TrackState.TENTATIVE), (1.2, TrackState.CONFIRMED)]
)
def test_a_patch_of_noise_on_what_stands_is_nobody(
    guest: MakeTrack, against: str, height: float, state: TrackState
) -> None:
    """What is as high as a part of a person may be one with a wall, or where it was before."""
    track = guest(arrived=3, height=height)
    segment = track.outline.segment
    on_wall = replace(segment, clear=0.0)
    track.outline.segment = on_wall if against == "wall" else replace(segment, static=0.9)
    assert judged(track) is state


@pytest.mark.parametrize(
    ("height", "state"), [(0.5, TrackState.TENTATIVE), (1.2, TrackState.CONFIRMED)]
)
@pytest.mark.parametrize("side", [0, 1])
def test_a_patch_beside_somebody_nearer_is_nobody(
    guest: MakeTrack, side: int, height: float, state: TrackState
) -> None:
    """Only one camera sees what is there; a person who passes behind is taller than that."""
    track = guest(arrived=3, height=height)
    cut = (side == 0, side == 1, False, False)
    track.outline.segment = replace(track.outline.segment, cut=cut)
    assert judged(track) is state


def test_who_waves_is_confirmed_as_a_thing_of_its_own(guest: MakeTrack) -> None:
    """What flickers on a wall is none."""
    for clear, state in ((1.0, TrackState.CONFIRMED), (0.0, TrackState.TENTATIVE)):
        track = guest(STOOD)
        track.outline.segment = replace(track.outline.segment, apart=1.0, clear=clear)
        for k in range(30):
            track.changes.note(0.1 * k, changed=k % 3 < 2)
        assert judged(track) is state
        assert track.motion is MotionState.IN_PLACE


def test_who_comes_out_of_hiding_needs_more_frames_and_a_surer_velocity(guest: MakeTrack) -> None:
    """Of 3.9 standard deviations, and then of more than 16."""
    for sigma, state in ((0.13, TrackState.TENTATIVE), (0.03, TrackState.CONFIRMED)):
        assert judged(guest(AWAY, hidden=4, sigma=sigma)) is state
    assert judged(guest(arrived=3, sigma=0.13)) is TrackState.CONFIRMED


def test_what_others_uncover_seems_to_move_across_and_is_not_confirmed(guest: MakeTrack) -> None:
    for velocity in ((0.5, 0.0, 0.0), (0.5, 0.0, 0.4), (0.0, 0.0, -0.5)):
        assert judged(guest(velocity, hidden=50), 20) is TrackState.TENTATIVE


def test_an_outline_confirms_only_while_it_moves(guest: MakeTrack) -> None:
    for velocity in (STOOD, (P.stopped_below_mps / 2, 0.0, 0.0)):
        # However surely it creeps.
        track = guest(velocity, arrived=50, hidden=50, sigma=1e-3)
        assert judged(track, 20) is TrackState.TENTATIVE
        assert track.motion is MotionState.STOPPED


def test_a_velocity_that_is_hardly_known_confirms_nobody(guest: MakeTrack) -> None:
    assert judged(guest(arrived=10, sigma=0.4), 20) is TrackState.TENTATIVE


def test_an_outline_confirms_only_while_it_is_seen(guest: MakeTrack) -> None:
    track = guest(arrived=10)
    track.outline.seen = False
    assert judged(track) is TrackState.TENTATIVE
    track.outline.seen, track.missed_s = True, 0.1
    assert judged(track) is TrackState.TENTATIVE


def test_a_confirmed_one_stays_confirmed_when_it_stops(guest: MakeTrack) -> None:
    track = guest(arrived=3)
    judged(track)
    track.filter = guest(STOOD).filter
    assert judged(track) is TrackState.CONFIRMED
    assert track.motion is MotionState.STOPPED


def test_points_of_what_is_one_with_its_surroundings_do_not_confirm(make_track: MakeTrack) -> None:
    """Unless they are many, and stand out of the ground: reflections lie below it."""
    for points, merged_s, stands, state in (
        (11, 0.1, True, TrackState.TENTATIVE),
        (11, 0.0, True, TrackState.CONFIRMED),
        (20, 0.1, True, TrackState.CONFIRMED),
        (20, 0.1, False, TrackState.TENTATIVE),
    ):
        track = make_track()
        track.points, track.merged_s, track.stands = points, merged_s, stands
        assert judged(track, P.confirm_hits + 5) is state


@pytest.mark.parametrize(
    ("velocity", "crosses"),
    [((0.5, 0.0, 0.1), True), ((0.1, 0.0, -0.5), False), ((0.12, 0.0, 0.0), False)],
)
def test_points_of_what_is_one_with_its_surroundings_may_surely_cross_the_view(
    make_track: MakeTrack, velocity: tuple[float, float, float], crosses: bool
) -> None:
    """They do not confirm it; and what comes straight on or creeps may be an edge that stands."""
    track = make_track((0.0, 0.0, 4.0), velocity)
    track.points, track.merged_s = 9, 0.1
    judged(track)
    assert not track.crosses, "one frame tells nothing"
    assert judged(track, P.confirm_hits) is TrackState.TENTATIVE
    assert track.crosses is crosses


@pytest.mark.parametrize(
    ("velocity", "state"),
    [((0.5, 0.0, 0.1), TrackState.CONFIRMED), ((0.1, 0.0, -0.5), TrackState.TENTATIVE)],
)
def test_what_is_farther_than_segments_is_confirmed_by_points_only_if_it_crosses_the_view(
    make_track: MakeTrack, velocity: tuple[float, float, float], state: TrackState
) -> None:
    for merged_s in (0.0, 0.1):
        track = make_track((0.0, 0.0, 9.0), velocity)
        track.points, track.merged_s, track.far = 20, merged_s, True
        assert judged(track, P.confirm_hits + 5) is state


def test_out_of_sight_a_body_moves_on_as_it_did_however_uncertain(make_track: MakeTrack) -> None:
    for missed_s, motion in ((0.0, MotionState.STOPPED), (1.0, MotionState.MOVING)):
        track = make_track(velocity=(0.5, 0.0, 0.0), sigma=0.3)
        track.state, track.missed_s = TrackState.CONFIRMED, missed_s
        judged(track)
        assert track.motion is motion


def test_whose_velocity_is_not_known_any_more_has_not_stopped_for_that(guest: MakeTrack) -> None:
    """Points of limbs were taken for the body, so that it may be slower or faster than they are."""
    track = guest(arrived=3)
    judged(track)
    assert (track.state, track.motion) == (TrackState.CONFIRMED, MotionState.MOVING)
    for sigma, motion in ((0.5, MotionState.MOVING), (0.1, MotionState.STOPPED)):
        track.filter = guest((0.2, 0.0, 0.0), sigma=sigma).filter
        judged(track)
        assert track.motion is motion


def test_who_comes_back_and_of_whose_velocity_nothing_is_known_yet_has_not_stopped(
    guest: MakeTrack,
) -> None:
    track = guest(arrived=3)
    judged(track)
    track.filter = guest(STOOD, sigma=1.0).filter
    judged(track)
    assert track.motion is MotionState.MOVING
    # But what stays so has not come back: something else is there.
    judged(track, 10)
    assert track.motion is MotionState.STOPPED


def test_who_fills_what_was_filled_before_has_stopped_however_uncertain(guest: MakeTrack) -> None:
    track = guest(arrived=3)
    judged(track)
    track.filter = guest((0.2, 0.0, 0.0), sigma=0.5).filter
    for static, motion in ((0.9, MotionState.MOVING), (1.0, MotionState.STOPPED)):
        track.outline.segment = replace(track.outline.segment, static=static)
        judged(track)
        assert track.motion is motion


def test_what_was_not_reported_yet_and_is_hardly_known_does_not_move(guest: MakeTrack) -> None:
    track = guest((0.5, 0.0, 0.0), sigma=0.5)
    judged(track)
    assert track.motion is MotionState.STOPPED


def test_points_that_creep_where_something_was_before_confirm_nothing(guest: MakeTrack) -> None:
    """A highlight on a chair, while the light changes; and a robot that drives slowly."""
    for speed, evidence, state in (
        (0.1, STATIC, TrackState.TENTATIVE),
        (0.25, STATIC, TrackState.CONFIRMED),
        (0.1, ARRIVED, TrackState.CONFIRMED),
    ):
        track = guest((speed, 0.0, 0.0), sigma=0.005, evidence=evidence)
        track.points = 12
        assert judged(track, 5) is state


@pytest.mark.parametrize(
    ("velocity", "evidence", "rigid", "state"),
    [
        ((0.7, 0.0, -0.7), STATIC, False, TrackState.TENTATIVE),
        ((0.0, 0.0, -0.7), STATIC, False, TrackState.CONFIRMED),
        ((0.7, 0.0, -0.7), ARRIVED, False, TrackState.CONFIRMED),
        ((0.7, 0.0, -0.7), STATIC, True, TrackState.CONFIRMED),
    ],
)
def test_points_of_limbs_that_cross_what_stands_confirm_nobody(
    guest: MakeTrack,
    velocity: tuple[float, float, float],
    evidence: int,
    rigid: bool,
    state: TrackState,
) -> None:
    """Who comes along the line of sight may fill for a while what was filled before."""
    track = guest(velocity, evidence=evidence)
    track.points, track.rigid = 16, rigid
    assert judged(track, 5) is state


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
def test_in_light_that_flickers_what_only_comes_or_goes_may_stand(
    guest: MakeTrack, velocity: tuple[float, float, float], evidence: int, state: TrackState
) -> None:
    """Unless it is fast, moves across the view, or enters what was free."""
    for light, expected in ((STEADY, TrackState.CONFIRMED), (Light(flickers=True), state)):
        track = guest(velocity, sigma=0.005, evidence=evidence)
        track.points = 12
        assert judged(track, 5, light=light) is expected


def test_while_the_exposure_swings_it_takes_more_to_enter_free_space(guest: MakeTrack) -> None:
    """What is cut off as too bright has another depth when it is not."""
    swings = Light(swings=True)
    certain, uncertain = 0.02, 0.12
    for arrived, sigma, expected in (
        (3, certain, TrackState.TENTATIVE),
        (6, uncertain, TrackState.TENTATIVE),
        (6, certain, TrackState.CONFIRMED),
    ):
        assert judged(guest(arrived=arrived, sigma=sigma), light=swings) is expected
        assert judged(guest(arrived=arrived, sigma=sigma)) is TrackState.CONFIRMED


# --- the end -------------------------------------------------------------------------------


@pytest.mark.parametrize("why", ["part_moves", "loosened"])
def test_a_person_of_whom_a_part_or_points_moved_is_confirmed_by_a_less_sure_velocity(
    guest: MakeTrack, why: str
) -> None:
    """Of 4 standard deviations; of 2.5, which is hardly more than who waves may show, nobody is."""
    for speed, known, state in (
        (0.8, True, TrackState.CONFIRMED),
        (0.8, False, TrackState.TENTATIVE),
        (0.5, True, TrackState.TENTATIVE),
    ):
        track = guest((0.0, 0.0, -speed), sigma=0.2, evidence=STATIC)
        setattr(track, why, known)
        track.points = 12
        assert judged(track, 5) is state


def test_what_moves_as_a_thing_of_its_own_goes_on(guest: MakeTrack) -> None:
    track = guest(arrived=3)
    judged(track)
    track.age_s = 10.0
    assert not any(is_over(track, P) for _ in range(20))


def ends_after(track: BodyTrack, most: int = 20) -> int | None:
    """Frames until it is over; None if it never is."""
    return next((k for k in range(1, most) if is_over(track, P)), None)


def test_a_tentative_outline_that_stands_ends_after_a_few_frames(guest: MakeTrack) -> None:
    assert ends_after(guest(STOOD, evidence=STATIC)) == 4


def test_a_person_of_whom_a_part_moved_may_stand(guest: MakeTrack) -> None:
    track = guest(STOOD, evidence=STATIC)
    track.part_moves = True
    assert ends_after(track) is None


def test_one_whose_points_tell_that_it_moves_may_stand(guest: MakeTrack) -> None:
    """Who comes straight on from afar is mostly where he was for a second."""
    for sigma, ends in ((0.2, None), (0.5, 4)):
        track = guest((0.0, 0.0, -0.8), sigma=sigma, evidence=STATIC)
        assert track.outline is not None
        track.outline.depths.tell = True
        judged(track)
        assert ends_after(track) == ends


def test_a_confirmed_one_may_stand(guest: MakeTrack) -> None:
    track = guest(arrived=3, evidence=STATIC)
    judged(track)
    assert track.state is TrackState.CONFIRMED
    assert ends_after(track) is None


def stands(track: BodyTrack, at: tuple[float, float, float], frames: int) -> list[bool]:
    """Whether it is over in each frame in which it stands there."""
    cov = 1e-4 * np.eye(3)
    track.filter = BodyFilter.begin(np.array(at), np.array(STOOD), cov, cov, 0.01)
    over = []
    for _ in range(frames):
        judge(track, np.zeros(3), DT, P)
        over.append(is_over(track, P))
    return over


def test_one_that_stands_where_it_was_confirmed_ends_and_one_that_walked_stays(
    guest: MakeTrack,
) -> None:
    for at, ends in (((0.3, 0.0, 4.1), True), ((0.9, 0.0, 4.0), False)):
        track = guest(arrived=3)
        judged(track)
        over = stands(track, at, 12)
        assert not any(over[:6])
        assert any(over) is ends


def test_one_that_walked_and_came_back_does_not_end_where_it_began(guest: MakeTrack) -> None:
    track = guest(arrived=3)
    judged(track)
    assert not any(stands(track, (0.9, 0.0, 4.0), 2))
    assert not any(stands(track, (0.0, 0.0, 4.0), 20))


def test_where_it_would_be_out_of_sight_it_was_not_seen_to_walk(guest: MakeTrack) -> None:
    track = guest(arrived=3)
    judged(track)
    track.missed_s = 0.1
    stands(track, (0.9, 0.0, 4.0), 2)
    track.missed_s = 0.0
    assert any(stands(track, (0.0, 0.0, 4.0), 20))


def test_a_short_stop_and_points_that_show_it_end_nothing(guest: MakeTrack) -> None:
    track = guest(arrived=3)
    judged(track)
    going = track.filter
    for _ in range(4):
        assert not any(stands(track, (0.0, 0.0, 4.0), 5))
        track.filter = going
        judged(track)
    track.points = 30
    assert not any(stands(track, (0.0, 0.0, 4.0), 20))


def test_a_confirmed_one_that_swallows_what_stands_ends(guest: MakeTrack) -> None:
    track = guest(arrived=3, evidence=STATIC)
    judged(track)
    track.outline.moving_area /= 2
    assert ends_after(track) == 4


def test_one_idle_frame_now_and_then_ends_nothing(guest: MakeTrack) -> None:
    track = guest(STOOD, evidence=STATIC)
    standing = track.outline.segment
    moving = guest(STOOD).outline.segment
    for k in range(20):
        track.outline.segment = moving if k % 3 == 2 else standing
        assert not is_over(track, P)


def test_an_outline_is_given_more_time_to_move_than_points_are(
    guest: MakeTrack, make_track: MakeTrack
) -> None:
    ages = []
    for track in (guest(STOOD), make_track(velocity=STOOD)):
        while not is_over(track, P):
            track.age_s += 0.1
            assert track.age_s < 5.0
        ages.append(track.age_s)
    assert ages == pytest.approx([1.5, 0.5], abs=0.11)


def test_who_has_been_one_with_its_surroundings_for_long_ends(make_track: MakeTrack) -> None:
    track = make_track()
    track.state, track.merged_s = TrackState.CONFIRMED, 0.9
    assert not is_over(track, P)
    track.merged_s = 1.1
    assert is_over(track, P)
    # Many points that move on show it all the same.
    track.points = 20
    assert not is_over(track, P)
    track.motion = MotionState.STOPPED
    assert is_over(track, P)


def test_who_lost_its_outline_ends_when_it_stands_and_not_while_it_drives(guest: MakeTrack) -> None:
    track = guest(arrived=3)
    judged(track)
    assert track.outline is not None
    track.outline.seen, track.merged_s, track.points = False, 1.1, 5
    assert not is_over(track, P)
    track.motion = MotionState.STOPPED
    assert is_over(track, P)


def test_who_is_out_of_sight_coasts_and_then_ends(guest: MakeTrack) -> None:
    track = guest(arrived=3)
    judged(track)
    track.outline.seen, track.missed_s = False, P.coast_s
    assert judged(track) is TrackState.COASTING
    assert not is_over(track, P)
    track.missed_s = P.coast_s + 0.01
    assert is_over(track, P)


@pytest.mark.parametrize(
    ("speed", "sigmas", "motion"),
    [
        (0.4, 2.4, MotionState.MOVING),
        (0.4, 1.6, MotionState.STOPPED),
        (0.12, 2.4, MotionState.STOPPED),
    ],
)
def test_one_that_moves_is_not_said_to_stand_because_its_speed_became_uncertain(
    make_track: MakeTrack, speed: float, sigmas: float, motion: MotionState
) -> None:
    track = make_track((0.0, 0.0, 4.0), (0.0, 0.0, -speed), sigma=speed / sigmas)
    track.state, track.motion = TrackState.CONFIRMED, MotionState.MOVING
    judged(track)
    assert track.motion is motion


def test_what_was_never_sure_to_move_is_not_said_to(make_track: MakeTrack) -> None:
    for state in (TrackState.TENTATIVE, TrackState.CONFIRMED):
        track = make_track((0.0, 0.0, 4.0), (0.0, 0.0, -0.4), sigma=0.4 / 2.4)
        track.state, track.motion = state, MotionState.STOPPED
        judged(track)
        assert track.motion is MotionState.STOPPED
