"""People found to move in place, in worlds whose every change is known."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest

from observer.geometry import Pose
from observer.methods.rigid.bodies.beginning import start_track
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.changes import Changes
from observer.methods.rigid.bodies.lifecycle import judge
from observer.methods.rigid.bodies.moving_in_place import MovingInPlace
from observer.methods.rigid.dense.free_space import STATIC
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import segment_of
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.parameters import Parameters
from observer.types import MotionState, TrackState
from observer.vision.lifecycle import NO_OBSTACLE, TrackIds

from .... import builders
from ..solid_worlds import GRID, HERE, ROOM, Shape, Solid, cells_of, on_floor, person, seen
from .planted_bodies import DT

P = Parameters().obstacles
WHO = person(0.0, 4.0)
CABINET = on_floor(0.0, 4.0, (1.8, 1.0, 0.3))
# A wave of 0.9 Hz: an arm is fast for three frames of every eight.
WAVING = [k for k in range(40) if k % 8 < 3]


def hand(x: float = 0.3) -> Solid:
    return Solid((x, -0.4, 4.0), (0.2, 0.25, 0.2))


def scene(time: float, who: Shape, changed: Shape | None) -> DenseScene:
    shapes = [*ROOM, who]
    still = seen(shapes, HERE, np.full(GRID.shape, STATIC, np.uint8))
    mask = np.zeros(GRID.shape, np.bool_)
    if changed is not None:
        mask = cells_of(changed, [*shapes, changed])
        disparity = np.where(mask, still.disparity[cells_of(who, shapes)].max(), still.disparity)
        still = replace(still, disparity=disparity, standing=still.standing | mask)
    return replace(still, time=time, changed=mask)


def found(
    frames: Iterable[int],
    who: Shape = WHO,
    places: Callable[[int], Shape] = lambda _: hand(),
    lasting: int = 40,
    pose: Pose = HERE,
) -> list[BodyTrack]:
    """The bodies found when something changes in ``frames`` out of ``lasting`` frames."""
    in_place, numbers, tracks = MovingInPlace(), TrackIds(), list[BodyTrack]()
    now = set(frames)
    for k in range(lasting):
        still = scene(k * DT, who, places(k) if k in now else None)
        in_place.note(tracks, TrackedPoints.none(), replace(still, T_world_camera=pose), numbers)
        for track in tracks:
            judge(track, np.zeros(3), DT, P)
    return tracks


def test_a_waving_person_moves_in_place_and_does_not_travel() -> None:
    (track,) = found(WAVING)
    assert track.state is TrackState.CONFIRMED
    assert track.motion is MotionState.IN_PLACE
    assert np.linalg.norm(track.centre_velocity()[0]) < P.stopped_below_mps


def test_the_whole_person_is_found_not_only_the_hand() -> None:
    (track,) = found(WAVING)
    assert track.outline is not None
    assert track.outline.height == pytest.approx(1.6, abs=0.3)


def test_a_person_standing_still_is_not_found() -> None:
    assert found([]) == []


def test_a_single_flicker_is_not_motion() -> None:
    assert found(range(10, 16)) == []


def test_changes_at_a_cabinet_are_not_a_person() -> None:
    assert found(WAVING, CABINET) == []


@pytest.mark.parametrize("turned_deg", [0, 90, 180])
def test_adjacent_places_stay_separate_for_any_camera_direction(turned_deg: int) -> None:
    pose = Pose.from_rotvec((0, np.radians(turned_deg), 0), (0, 0, 0))
    # Twice at each of both is not enough, four times at one is.
    frames = [k for k in WAVING if k < 32]
    assert found(frames, places=lambda k: hand(0.4 if k % 16 < 8 else -0.4), pose=pose) == []
    assert len(found(frames, places=lambda _: hand(0.4), pose=pose)) == 1


def test_a_passing_hand_does_not_move_in_place() -> None:
    assert found(range(40), places=lambda k: hand(-1.5 + 0.075 * k)) == []


def test_a_person_has_stopped_after_waving() -> None:
    (track,) = found([k for k in WAVING if k < 30], lasting=90)
    assert track.motion is MotionState.STOPPED


@pytest.mark.parametrize(
    ("times", "recurring"),
    [
        ([], False),
        (np.arange(0, 2.5, 0.05), False),
        (np.arange(0, 2.5, 0.4), False),
        ([a + b for a in (0.0, 0.6, 1.2) for b in (0.0, 0.07, 0.14)], True),
        ([a + b for a in (0.0, 0.3, 0.6) for b in (0.0, 0.07, 0.14)], False),
        ([a + b for a in (0.0, 2.0, 4.0) for b in (0.0, 0.07, 0.14)], False),
    ],
)
def test_only_repeated_changes_are_recurring(times: list[float], recurring: bool) -> None:
    changes = Changes()
    for time in times:
        changes.note(time, changed=True)
    assert changes.recurring is recurring


def test_an_unconfirmed_part_becomes_the_whole_person() -> None:
    """A waving person's part that already has a track."""
    numbers = TrackIds()
    now = scene(0.0, WHO, hand())
    assert now.changed is not None
    part = segment_of(now, now.changed)
    in_place, tracks = MovingInPlace(), [start_track(numbers.provisional(), part, now)]
    other = 7
    points = builders.watched(
        GRID.camera, np.full((2, 3), 3.0), np.zeros(3), np.random.default_rng(1)
    ).but(obstacle=np.array([tracks[0].id, other]))
    for k in range(40):
        now = scene(k * DT, WHO, hand() if k in set(WAVING) else None)
        points = in_place.note(tracks, points, now, numbers)
    (track,) = tracks
    # The part's points are free to join another body.
    assert points.obstacle.tolist() == [NO_OBSTACLE, other]
    assert track.outline is not None
    assert track.outline.height == pytest.approx(1.6, abs=0.3)
