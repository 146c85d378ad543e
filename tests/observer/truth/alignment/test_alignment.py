"""A whole run and a whole capture with planted clocks, room, camera, tracks and truth."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from observer.errors import NotObservable, TruthError
from observer.mount import CameraMount
from observer.truth.alignment.aligned import AlignedTruth
from observer.truth.alignment.alignment import align
from observer.truth.alignment.choices import AlignmentChoices
from observer.truth.alignment.observed import ObservedRun, TrackKey
from observer.truth.alignment.online import OnlineAlignment, pieces
from observer.truth.alignment.result import Alignment
from observer.truth.motion_capture import BodySample, Capture, Trajectory

from .conftest import to_source

Rooms = Callable[..., Any]


def aligned(room: Any, **choices: Any) -> Alignment:
    return align(ObservedRun.of_lines(room.lines), room.capture, AlignmentChoices(**choices))


@pytest.fixture(scope="module")
def found(room: Any, mount: CameraMount) -> Alignment:
    return aligned(room, mount=mount)


@pytest.mark.patient
def test_planted_offsets_are_found_with_the_observer_visible(
    rooms: Rooms, mount: CameraMount
) -> None:
    errors, within = [], []
    for seed in range(6):
        offset = (0.05, -0.12, 0.3)[seed % 3]
        found = aligned(rooms(seed, offset=offset), mount=mount)
        errors.append(abs(found.time.offset_s - offset))
        within.append(errors[-1] <= 2 * found.time.sigma_s)
    assert np.median(errors) <= 0.005
    assert sum(within) >= 5


def test_all_planted_values_are_recovered(room: Any, found: Alignment) -> None:
    assert found.roles == {"Amigo": "observer", "P3DX": "obstacle"}
    assert found.time.offset_s == pytest.approx(0.3, abs=0.005)
    assert {str(key): m.body for key, m in found.matches.items()} == {"0:1": "P3DX"}
    apart = found.T_world_room[0].inverse() @ room.T_world_room
    assert np.degrees(np.linalg.norm(apart.rotvec)) < 1.0
    assert np.linalg.norm(apart.translation) < 0.05
    assert found.T_body_camera is not None
    np.testing.assert_allclose(found.T_body_camera.matrix, room.T_body_camera.matrix, atol=0.03)
    assert any("assigned to the observer" in note for note in found.notes)
    truth = AlignedTruth(room.capture, found)
    places, speeds = [], []
    for time in np.arange(2, 24, 0.1):
        bodies = {body.role: body for body in truth.bodies(time)}
        if "obstacle" in bodies:
            body = bodies["obstacle"]
            assert (body.id, body.name, body.visible) == (1, "P3DX", None)
            places.append(np.linalg.norm(body.position - room.centre(time)))
            speeds.append(body.speed - room.speed(time))
            assert truth.speed("P3DX", time) == pytest.approx(body.speed)
    assert len(places) > 150
    assert np.median(places) < 0.05
    # Except in quick turns, when the markers swing about the centre.
    assert np.median(np.abs(speeds)) < 0.01
    camera = truth.camera_pose(10.0)
    assert camera is not None
    seen = room.lines[150]["pose"]["position"]
    assert np.linalg.norm(camera.translation - seen) < 0.03


def test_motion_capture_gaps_remain_gaps(room: Any, found: Alignment) -> None:
    body = room.capture.bodies["P3DX"]
    truth = AlignedTruth(room.capture, found)
    lost = body.times[~body.seen][5:-5]
    assert len(lost)
    time = float(to_source(found.time, lost)[3])
    assert "P3DX" not in {b.name for b in truth.bodies(time)}
    assert truth.speed("P3DX", time) is None
    assert truth.bodies(1000.0) == ()


def test_obstacles_alone_determine_the_room_without_the_observer(
    rooms: Rooms, mount: CameraMount
) -> None:
    room = rooms(1, observer=False)
    found = aligned(room, mount=mount)
    assert found.observer is None
    assert found.T_body_camera is None
    assert found.time.offset_s == pytest.approx(0.3, abs=3 * found.time.sigma_s)
    assert found.time.sigma_s < 0.02
    assert any("using only the obstacles" in note for note in found.notes)
    truth = AlignedTruth(room.capture, found)
    assert truth.camera_pose(10.0) is None
    (body,) = truth.bodies(11.0)
    # Only its one turn separates the markers' place on the obstacle from the room's pose.
    assert np.linalg.norm(body.position - room.centre(11.0)) < 0.5


@pytest.mark.parametrize("glimpsed_s", [0.46, 1.0])
def test_body_seen_for_a_moment_does_not_hide_the_fit_of_the_others(
    rooms: Rooms, mount: CameraMount, glimpsed_s: float
) -> None:
    """No lag compares five of its speeds, so nothing is known about it, at any lag."""
    room = rooms(1, observer=False)
    body = room.capture.bodies["P3DX"]
    place = np.full_like(body.positions, np.nan)
    seen = (body.times > 20) & (body.times < 20 + glimpsed_s)
    place[seen] = [1.0, 2.0, 0.1] + 0.3 * (body.times[seen, None] - 20)
    wand = Trajectory("wand", body.times, place)
    capture = Capture("planted", 100.0, {"P3DX": body, "wand": wand})
    found = align(ObservedRun.of_lines(room.lines), capture, AlignmentChoices(mount=mount))
    assert found.time.offset_s == pytest.approx(0.3, abs=3 * found.time.sigma_s)
    assert {str(key): m.body for key, m in found.matches.items()} == {"0:1": "P3DX"}


def test_obstacle_moving_like_the_camera_is_not_mistaken_for_the_observer(
    room: Any, mount: CameraMount
) -> None:
    amigo = room.capture.bodies["Amigo"]
    # It starts and stops at the same times, but three times as fast.
    twin = Trajectory("twin", amigo.times, 3 * amigo.positions)
    bodies = {"P3DX": room.capture.bodies["P3DX"], "twin": twin}
    found = align(
        ObservedRun.of_lines(room.lines),
        Capture("planted", 100.0, bodies),
        AlignmentChoices(mount=mount),
    )
    assert found.observer is None


def test_each_segment_has_its_own_world(rooms: Rooms, mount: CameraMount) -> None:
    room = rooms(2, segments=2)
    found = aligned(room, mount=mount, roles={"Amigo": "observer"})
    assert sorted(found.T_world_room) == [0, 1]
    truth = AlignedTruth(room.capture, found)
    for line in (room.lines[120], room.lines[300]):
        camera = truth.camera_pose(line["time"])
        assert camera is not None
        assert np.linalg.norm(camera.translation - line["pose"]["position"]) < 0.05
        (obstacle,) = (b for b in truth.bodies(line["time"]) if b.role == "obstacle")
        seen = np.array(line["obstacles"][0]["position"])
        assert np.linalg.norm(obstacle.position - seen) < 0.1


def test_only_speeds_are_compared_when_the_room_pose_is_unknown(rooms: Rooms) -> None:
    room = rooms(3, observer=False)
    # Positions are unknown without a camera pose; speeds from two frames are not.
    lines = []
    for line in room.lines:
        entries = [
            entry | {"position": None, "velocity_time": line["time"] - 0.033,
                     "speed": room.speed(line["time"] - 0.033)}
            for entry in line["obstacles"]
        ]  # fmt: skip
        lines.append(line | {"pose": None, "obstacles": entries})
    found = align(ObservedRun.of_lines(lines), room.capture)
    assert found.time.offset_s == pytest.approx(0.3, abs=0.02)
    assert found.T_world_room == {}
    assert any("only speeds are compared" in note for note in found.notes)
    assert found.matches[TrackKey(0, 1)].body == "P3DX"
    truth = AlignedTruth(room.capture, found)
    assert truth.bodies(5.0) == ()
    assert truth.speed("P3DX", 5.0) == pytest.approx(0.35, abs=0.02)


def test_user_corrections_and_roles_are_respected(room: Any, mount: CameraMount) -> None:
    found = aligned(room, mount=mount, matches={TrackKey(0, 1): None})
    assert found.matches[TrackKey(0, 1)].by == "person"
    assert found.matches[TrackKey(0, 1)].body is None
    ignored = aligned(room, mount=mount, roles={"Amigo": "ignored"})
    assert ignored.roles == {"P3DX": "obstacle"}
    with pytest.raises(TruthError, match="no body 'Vicon'; it has P3DX, Amigo"):
        aligned(room, roles={"Vicon": "observer"})
    with pytest.raises(TruthError, match="only one body"):
        AlignmentChoices(roles={"a": "observer", "b": "observer"})


def test_alignment_round_trips_as_plain_data(found: Alignment) -> None:
    again = Alignment.of_dict(json.loads(json.dumps(found.as_dict(), allow_nan=False)))
    assert again.as_dict() == found.as_dict()
    assert again.time == found.time
    with pytest.raises(TruthError, match="align the run again"):
        Alignment.of_dict({"time": {}})


def test_captures_without_common_motion_are_refused(room: Any) -> None:
    t = np.arange(0, 20, 0.01)
    still = Trajectory("box", t, np.zeros((len(t), 3)))
    with pytest.raises(NotObservable, match="constant"):
        align(ObservedRun.of_lines(room.lines), Capture("still", 100.0, {"box": still}))
    with pytest.raises(NotObservable, match="no speeds can be compared"):
        align(ObservedRun.of_lines(room.lines), Capture("empty", 100.0, {}))


def test_foreign_observation_lines_are_refused() -> None:
    with pytest.raises(TruthError, match=r"line 1 of the observations.*KeyError"):
        ObservedRun.of_lines([{"time": 0.0}])


def test_online_alignment_reports_not_yet_aligned_until_solved(
    room: Any, mount: CameraMount
) -> None:
    online = OnlineAlignment(AlignmentChoices(mount=mount, search=(-1, 1)))
    assert not online.solve()
    assert str(online.state).startswith("not aligned yet")
    samples = [
        BodySample(name, float(t), float(t), p if np.isfinite(p).all() else None,
                   R if np.isfinite(R).all() else None)
        for name, body in room.capture.bodies.items()
        for t, p, R in zip(body.times, body.positions, body.rotations, strict=True)
    ]  # fmt: skip
    samples.sort(key=lambda sample: sample.time)
    tried, taken, first = 0, 0, None
    for line in room.lines:
        online.add_observation(line)
        until = taken
        while until < len(samples) and samples[until].time + room.offset <= line["time"]:
            until += 1
        online.add_pieces(pieces(samples[taken:until]))
        taken = until
        # A caller may ask less often than every two seconds, and never gets more.
        if line["frame"] % 60 == 59 and online.solve():
            tried += 1
        if first is None and isinstance(online.state, Alignment):
            first = line["time"]
        if line["time"] < 2:
            assert str(online.state).startswith("not aligned yet: ")
    assert 3 < tried <= 6
    assert isinstance(online.state, Alignment)
    assert first is not None
    assert first < 15
    assert online.state.time.offset_s == pytest.approx(0.3, abs=0.02)
    online.add_observation(room.lines[0])
    assert str(online.state).startswith("not aligned yet")
