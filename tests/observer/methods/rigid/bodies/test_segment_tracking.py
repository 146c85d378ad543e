"""Bodies tracked by their segments, in worlds of boxes on prescribed paths."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from observer.geometry import Float64Array, Pose
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import POSITION, VELOCITY, YAW_RATE
from observer.methods.rigid.bodies.segment_tracking import learn_box, measure_limbs
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.motion_test import pooled_motion
from observer.methods.rigid.tracked_points import TrackedPoints, WorldSightings
from observer.parameters import Parameters
from observer.types import MotionState, TrackState
from observer.vision.lifecycle import NO_OBSTACLE, TrackIds

from ..solid_worlds import (
    CAMERA,
    DT,
    ROOM,
    Shape,
    Solid,
    SolidView,
    arrived,
    on_floor,
    outlined,
    patch,
    person,
    points_on,
    tracked,
)
from ..solid_worlds import step_to as now_at

MakeTrack = Callable[..., BodyTrack]


def walk(
    view: SolidView,
    path: Callable[[float], tuple[float, float]],
    frames: int,
    *others: Shape,
    poses: Callable[[float], Pose] = lambda _: Pose.identity(),
) -> list[tuple[float, float]]:
    """Let a person walk along ``path`` (x, z metres by time); return the place in each frame."""
    start_s = view.time
    places = []
    for _ in range(frames):
        since = view.time + DT - start_s
        places.append(path(since))
        view.step([*ROOM, *others, person(*places[-1])], poses(since))
    return places


def watching(*others: Shape) -> SolidView:
    """A view that has seen an empty room for some time."""
    view = SolidView()
    for _ in range(5):
        view.step([*ROOM, *others])
    assert view.tracks == []
    return view


def confirmed(view: SolidView) -> BodyTrack:
    (track,) = [t for t in view.tracks if t.state is TrackState.CONFIRMED]
    return track


# --- seen by depth alone -------------------------------------------------------------------


def test_a_person_walking_in_is_confirmed_and_measured_without_points() -> None:
    view = watching(on_floor(1.6, 5.0, (0.6, 0.8, 0.4)))
    walk(view, lambda t: (-0.8 + 0.8 * t, 4.0), 18, on_floor(1.6, 5.0, (0.6, 0.8, 0.4)))
    track = confirmed(view)
    assert track.motion is MotionState.MOVING
    assert not track.rigid
    np.testing.assert_allclose(track.centre[[0, 2]], [-0.8 + 0.8 * 1.8, 4.0], atol=0.12)
    np.testing.assert_allclose(track.centre_velocity()[0][[0, 2]], [0.8, 0.0], atol=0.15)
    assert track.box is not None
    assert track.box.size[0] == pytest.approx(0.45, abs=0.1)


def test_a_ball_rolling_in_is_confirmed_and_measured_without_points() -> None:
    view = watching()
    for k in range(20):
        view.step([*ROOM, on_floor(-0.8 + 0.08 * k, 3.0, (0.25, 0.25, 0.25))])
    track = confirmed(view)
    assert track.motion is MotionState.MOVING
    np.testing.assert_allclose(track.centre[[0, 2]], [-0.8 + 0.08 * 19, 3.0], atol=0.12)
    np.testing.assert_allclose(track.centre_velocity()[0][[0, 2]], [0.8, 0.0], atol=0.2)


def test_something_small_that_moves_above_the_ground_starts_no_track() -> None:
    view = watching()
    for k in range(20):
        hanging = Solid((-0.8 + 0.08 * k, 0.2, 3.0), (0.25, 0.25, 0.25))
        view.step([*ROOM, hanging])
        assert view.tracks == []


def test_something_small_that_moves_beside_something_larger_starts_no_track() -> None:
    """As the foot of a person who stands."""
    crate = on_floor(0.0, 3.3, (0.5, 0.6, 0.3))
    view = watching(crate)
    for k in range(8):
        view.step([*ROOM, crate, on_floor(0.65 - 0.01 * k, 3.0, (0.25, 0.25, 0.25))])
        assert view.tracks == []


def test_something_small_that_moves_beside_a_person_is_no_other_obstacle() -> None:
    view = watching()
    for k in range(20):
        x = -0.8 + 0.08 * k
        view.step([*ROOM, person(x, 4.0), on_floor(x + 0.7, 4.0, (0.25, 0.25, 0.25))])
    assert len([t for t in view.tracks if t.state is TrackState.CONFIRMED]) == 1


def test_a_person_walking_towards_a_moving_camera_is_measured() -> None:
    view = watching()

    def poses(t: float) -> Pose:
        return Pose.from_rotvec([0.0, 0.1 * t, 0.0], [0.0, 0.0, 0.3 * t])

    walk(view, lambda t: (0.2, 5.5 - 0.7 * t), 20, poses=poses)
    track = confirmed(view)
    np.testing.assert_allclose(track.centre[[0, 2]], [0.2, 5.5 - 0.7 * 2.0], atol=0.15)
    np.testing.assert_allclose(track.centre_velocity()[0][[0, 2]], [0.0, -0.7], atol=0.2)


def test_a_standing_person_is_never_confirmed_by_a_moving_camera() -> None:
    view = SolidView()
    for k in range(25):
        pose = Pose.from_rotvec([0.0, 0.01 * k, 0.0], [0.02 * k, 0.0, 0.04 * k])
        view.step([*ROOM, person(0.3, 4.5), on_floor(-0.9, 4.0, (0.6, 0.7, 0.5), 0.4)], pose)
        assert all(t.state is TrackState.TENTATIVE for t in view.tracks)


def test_a_stopped_body_keeps_its_position_and_size() -> None:
    view = watching()
    walk(view, lambda t: (-0.6 + 0.8 * min(t, 1.5), 4.0), 40)
    track = confirmed(view)
    assert track.motion is MotionState.STOPPED
    np.testing.assert_allclose(track.centre[[0, 2]], [0.6, 4.0], atol=0.12)
    assert track.outline.width == pytest.approx(0.45, abs=0.1)


def leave_to_the_left(view: SolidView) -> int:
    """Let a person run out of view and stay away for a moment; return the track's number."""
    walk(view, lambda t: (0.6 - 2.0 * t, 4.0), 16)
    number = confirmed(view).id
    for _ in range(7):
        view.step(ROOM)
    return number


def test_a_person_who_comes_back_over_the_border_keeps_the_number() -> None:
    view = watching()
    number = leave_to_the_left(view)
    walk(view, lambda t: (-2.7 + 2.0 * t, 4.0), 6)
    assert number in [t.id for t in view.tracks if t.missed_s == 0]


@pytest.mark.parametrize(
    "newcomer", [person(-0.7, 4.0), on_floor(-1.4, 4.0, (1.6, 1.2, 0.2))], ids=["inside", "wide"]
)
def test_who_has_left_is_not_what_appears_elsewhere(newcomer: Shape) -> None:
    """A person is noticed soon after coming back, and has not grown."""
    view = watching()
    number = leave_to_the_left(view)
    for _ in range(3):
        view.step([*ROOM, newcomer])
    assert [t for t in view.tracks if t.missed_s == 0]
    assert number not in [t.id for t in view.tracks if t.missed_s == 0]


@pytest.mark.parametrize("side", [-1, 1])
def test_two_crossing_people_keep_their_numbers(side: int) -> None:
    view = watching()
    ids: list[tuple[int, int]] = []
    for k in range(26):
        t = k * DT
        near, far = (side * (0.7 - 0.6 * t), 2.9), (side * (-1.0 + 0.8 * t), 4.6)
        view.step([*ROOM, person(*near), person(*far)])
        every = [t for t in view.tracks if t.state is not TrackState.TENTATIVE]
        if len(every) == 2:
            by_depth = sorted(every, key=lambda t: float(t.mean[2]))
            ids.append((by_depth[0].id, by_depth[1].id))
            np.testing.assert_allclose(by_depth[0].centre[[0, 2]], near, atol=0.25)
    assert len(ids) > 12
    assert len(set(ids)) == 1


# --- place of a partly visible body --------------------------------------------------------


def test_a_body_cut_off_by_the_image_border_moves_on_smoothly() -> None:
    """Its side shows where it is: the middle of the visible remainder would come to rest."""
    view = watching()
    speed, places = 0.8, []
    for k in range(25):
        x = 0.6 + speed * k * DT
        view.step([*ROOM, person(x, 4.0)])
        if k > 8 and x < 2.5:
            places.append((x, float(confirmed(view).mean[0]), confirmed(view).outline.segment.cut))
    true, found = np.array([p[0] for p in places]), np.array([p[1] for p in places])
    cut = np.array([p[2][1] for p in places])
    assert cut.any()
    assert not cut.all()
    steps = np.diff(found - true)
    assert np.abs(steps).max() < 0.06
    assert np.ptp(found - true) < 0.12


def test_the_offset_of_a_new_anchor_is_learned_on_first_use(
    make_track: MakeTrack,
) -> None:
    """Thus a body does not jump when it is measured by its side from then on."""
    newcomer = person(0.1, 4.0)
    track = make_track((0.1, 0.2, 3.875), (0.0, 0.0, 0.0))
    track.loosen()
    tracked([track], points_on(patch(0.1, 0.0, 3.87)), arrived(newcomer))
    assert set(track.outline.offsets) == {"middle"}
    before = track.mean[POSITION].copy()
    pillar = on_floor(0.18, 2.4, (0.3, 2.4, 0.1))
    tracked([track], TrackedPoints.none(), arrived(newcomer, pillar))
    assert track.outline.seen
    assert set(track.outline.offsets) == {"middle", "left"}
    np.testing.assert_allclose(track.mean[POSITION], before, atol=0.02)
    across = track.outline.offsets["left"][0] - track.outline.offsets["middle"][0]
    assert across == pytest.approx(-0.225, abs=0.05)


# --- rigid bodies and bodies with limbs ----------------------------------------------------


def limbs_measured(
    track: BodyTrack,
    scene: DenseScene,
    points: TrackedPoints,
    moved: Sequence[float] = (0.0, 0.0, 0.0),
) -> TrackedPoints:
    """Measure limbs with points seen ``moved`` (3,) metres from where they were."""
    points = points.but(within=np.full(len(points), track.id))
    place = CAMERA.triangulate(points.px, points.disparity) + np.asarray(moved)
    sightings = WorldSightings(place, np.tile(np.eye(3) * 1e4, (len(points), 1, 1)))
    motion = pooled_motion(points, now_at(), Parameters().evidence)
    return measure_limbs([track], points, sightings, motion, scene, DT)


def many(x: float, z: float) -> Float64Array:
    return np.concatenate([patch(x, y, z, 0.15) for y in (-0.4, -0.2, 0.0, 0.2, 0.6)])


def test_points_on_a_body_with_limbs_are_unassigned_but_measure_its_trunk() -> None:
    newcomer = person(0.1, 4.0)
    tracks, host = outlined(newcomer, TrackIds())
    points = points_on(many(0.1, 3.87)).but(obstacle=np.full(45, host.id))
    points = limbs_measured(host, arrived(newcomer), points)
    assert (points.obstacle == NO_OBSTACLE).all()
    assert host.points == 45
    assert tracks == [host]
    before = host.mean[POSITION].copy()
    host.age_s += DT
    limbs_measured(host, arrived(newcomer), points, (0.0, 0.0, 0.04))
    np.testing.assert_allclose(host.mean[POSITION] - before, [0.0, 0.0, 0.04], atol=0.01)


def test_a_segment_replacing_points_does_not_shift_the_body_in_depth() -> None:
    """The points show changes of depth well; all depths of a segment are wrong by the same."""
    newcomer = person(0.1, 4.0)
    tracks, host = outlined(newcomer, TrackIds())
    points, scene = points_on(many(0.1, 3.87)), arrived(newcomer)

    def see(seen: TrackedPoints, farther_m: float) -> None:
        host.filter = host.filter.predicted(DT, (0.6, 1.1), (0.0, 0.0), None)
        host.age_s += DT
        tracked(tracks, TrackedPoints.none(), scene)
        limbs_measured(host, scene, seen, (0.0, 0.0, farther_m))

    for k in range(12):
        see(points, 0.02 * k)
    assert host.outline.depths.measured
    before = host.mean[VELOCITY].copy()
    for _ in range(4):
        see(TrackedPoints.none(), 0.0)
    assert before[2] > 0.15
    np.testing.assert_allclose(host.mean[VELOCITY], before, atol=0.05)


def test_points_at_a_different_depth_are_not_on_the_body() -> None:
    newcomer = person(0.1, 4.0)
    _, host = outlined(newcomer, TrackIds())
    limbs_measured(host, arrived(newcomer), points_on(many(0.1, 6.0)))
    assert host.points == 0


def test_a_body_with_points_all_over_its_outline_stays_rigid(make_track: MakeTrack) -> None:
    """Even though it is as upright as a person."""
    newcomer = person(0.1, 4.0)
    track = make_track((0.1, 0.2, 3.9), (0.3, 0.0, 0.0), number=1, yaw_rate=0.3)
    _, host = outlined(newcomer, TrackIds())
    track.outline = host.outline
    track.points, track.box_px = 45, host.outline.box_px
    for _ in range(20):
        points = limbs_measured(track, arrived(newcomer), points_on(many(0.1, 3.87)))
    assert track.rigid
    assert (points.obstacle == 1).all()
    assert track.mean[YAW_RATE] == pytest.approx(0.3)


def test_the_box_of_a_body_follows_its_outline() -> None:
    _, host = outlined(person(0.1, 4.0), TrackIds())
    learn_box(host)
    np.testing.assert_allclose(host.box.size[:2], [0.45, 1.6], atol=0.15)
    np.testing.assert_allclose(host.centre[[0, 2]], [0.1, 4.0], atol=0.1)
    assert host.box_px == host.outline.box_px
    before = host.box
    host.outline.seen = False
    learn_box(host)
    assert host.box is before
