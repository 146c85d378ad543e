"""One camera on simulated frames: what it finds, what it refuses, and what it must not use."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from observer.explanation.answer import PixelVerdict
from observer.explanation.pixel import explain_pixel
from observer.jsonl import observation_line
from observer.methods.monocular.initialization import NO_GROUND
from observer.methods.monocular.method import NO_SCALE, NOT_TRAVELLED, ONLY_TURNED
from observer.mount import CameraMount
from observer.observer import Observer
from observer.parameters import Parameters
from observer.simulation.scenarios import load_scenario, scenario_from_text
from observer.simulation.source import SimulatedSource
from observer.simulation.truth import SimulatedTruth
from observer.simulation.world import World
from observer.trace import FullTrace
from observer.types import Observation, Status, StereoFrame, TrackState

ONE_CAMERA = Parameters().changed({"ego_motion.model": "monocular"})
LATERAL = World(load_scenario("lateral"), 3)
SOURCE = SimulatedSource(LATERAL)
MOUNT = SOURCE.info.mount
TRUTH = SimulatedTruth(LATERAL)
COUNT = 48


def read(source: SimulatedSource, count: int) -> list[StereoFrame]:
    frames = [source.read() for _ in range(count)]
    return [replace(f, right=f.left, received=0.0) for f in frames if f is not None]


@pytest.fixture(scope="module")
def lateral() -> list[StereoFrame]:
    """A robot crosses at about 0.35 m/s, 3.7 m ahead; the camera drives towards it."""
    return read(SOURCE, COUNT)


def without_odometry(frames: Sequence[StereoFrame]) -> list[StereoFrame]:
    return [replace(f, odometry=None) for f in frames]


def observe(
    frames: Sequence[StereoFrame],
    mount: CameraMount | None = MOUNT,
    parameters: Parameters = ONE_CAMERA,
) -> list[Observation]:
    observer = Observer(SOURCE.calibration, parameters, mount=mount, clock=lambda: 0.0)
    return [observer.observe(f) for f in frames]


def as_text(seen: Sequence[Observation]) -> list[str]:
    return [json.dumps(observation_line(o, tentative=True)) for o in seen]


@pytest.fixture(scope="module")
def seen(lateral: list[StereoFrame]) -> list[Observation]:
    return observe(lateral)


def distance_share(seen: Sequence[Observation], frames: Sequence[StereoFrame]) -> float:
    """Length of the path over the last frames relative to the true one."""
    start, end = COUNT - 10, COUNT - 1
    poses = [seen[k].T_world_camera for k in (start, end)]
    true = [TRUTH.camera_pose(frames[k].time) for k in (start, end)]
    assert poses[0] is not None
    assert poses[1] is not None
    distance = np.linalg.norm(poses[1].translation - poses[0].translation)
    return float(distance / np.linalg.norm(true[1].translation - true[0].translation))


def test_a_crossing_robot_is_confirmed_with_its_position_and_velocity(
    seen: list[Observation], lateral: list[StereoFrame]
) -> None:
    for observation, frame in list(zip(seen, lateral, strict=True))[25:]:
        (true,) = [b for b in TRUTH.bodies(frame.time) if b.id == 1]
        (o,) = observation.reported
        assert o.position is not None
        assert o.velocity is not None
        assert np.linalg.norm(o.position - true.position) < 0.3
        assert np.linalg.norm(o.velocity - true.velocity) < 0.15
        assert o.velocity_cov is not None
        error = o.velocity - true.velocity
        assert error @ np.linalg.inv(o.velocity_cov) @ error < 3.5**2
    assert len({o.id for s in seen[25:] for o in s.reported}) == 1
    assert "ground contact" in seen[-1].reported[0].reason


def test_odometry_and_mount_give_the_pose_in_metres(
    seen: list[Observation], lateral: list[StereoFrame]
) -> None:
    assert [s.status for s in seen[30:]] == [Status.OK] * (COUNT - 30)
    for observation, frame in zip(seen, lateral, strict=True):
        assert observation.T_world_camera is not None
        true = TRUTH.camera_pose(frame.time)
        gap = observation.T_world_camera.translation - true.translation
        assert np.linalg.norm(gap) < 0.03


def test_the_camera_height_alone_gives_metric_scale(lateral: list[StereoFrame]) -> None:
    seen = observe(without_odometry(lateral))
    assert seen[5].T_world_camera is None
    assert seen[5].status is Status.DEGRADED
    assert "not moved far enough" in seen[5].reasons[-1]
    assert {s.segment for s in seen} == {0}
    assert distance_share(seen, lateral) == pytest.approx(1, abs=0.05)


@pytest.fixture(scope="module")
def bare() -> list[StereoFrame]:
    """The same robot on plain tiles: the ground shows only joints."""
    text = "based_on: lateral\ntitle: x\nhelp: x\ntexture: {share_without: 1.0, robot: dark}\n"
    return without_odometry(read(SimulatedSource(World(scenario_from_text(text, "x"), 3)), COUNT))


def test_plain_tiles_and_the_height_give_metric_scale_and_a_crossing_robot(
    bare: list[StereoFrame],
) -> None:
    seen = observe(bare)
    assert distance_share(seen, bare) == pytest.approx(1, abs=0.08)
    for observation, frame in list(zip(seen, bare, strict=True))[35:]:
        assert observation.status is Status.OK
        (true,) = [b for b in TRUTH.bodies(frame.time) if b.id == 1]
        (o,) = observation.reported
        assert o.position is not None
        assert o.velocity is not None
        assert np.linalg.norm(o.position - true.position) < 0.4
        assert np.linalg.norm(o.velocity - true.velocity) < 0.2


def test_a_ground_without_joints_is_reported_as_giving_no_scale(
    bare: list[StereoFrame],
) -> None:
    rows = slice(130, None)
    blank = [np.array(f.left) for f in bare]
    for image in blank:
        image[rows] = 120
    seen = observe([replace(f, left=i, right=i) for f, i in zip(bare, blank, strict=True)])
    assert {s.status for s in seen} == {Status.DEGRADED}
    assert not any(s.obstacles for s in seen)
    assert seen[-1].reasons == (NO_GROUND,)


def test_odometry_alone_gives_metric_scale(lateral: list[StereoFrame]) -> None:
    seen = observe(lateral, mount=None)
    assert distance_share(seen, lateral) == pytest.approx(1, abs=0.05)
    # The ground on which obstacles stand is unknown.
    assert not any(s.obstacles for s in seen)


def test_a_given_height_takes_precedence_over_the_rig(lateral: list[StereoFrame]) -> None:
    assert MOUNT is not None
    tilt = float(np.degrees(MOUNT.tilt_rad))
    given = {"monocular.height_m": 2 * MOUNT.height_m, "monocular.tilt_deg": tilt}
    seen = observe(without_odometry(lateral), parameters=ONE_CAMERA.changed(given))
    assert distance_share(seen, lateral) == pytest.approx(2, abs=0.1)


def test_missing_scale_is_reported_as_lost_with_a_reason(lateral: list[StereoFrame]) -> None:
    for observation in observe(without_odometry(lateral[:12]), mount=None)[1:]:
        assert observation.status is Status.LOST
        assert observation.T_world_camera is None
        assert observation.obstacles == ()
        assert observation.reasons == (NO_SCALE,)
        assert observation.segment == 0


def test_a_camera_that_only_turns_is_reported() -> None:
    text = "based_on: static_turning\ncamera: {forward_m: 0.0}\ntitle: x\nhelp: x\n"
    source = SimulatedSource(World(scenario_from_text(text, "x"), 3))
    seen = observe(without_odometry(read(source, 25)))
    for observation in seen[10:]:
        assert observation.status is Status.DEGRADED
        assert observation.reasons == (ONLY_TURNED,)
        assert observation.T_world_camera is None
        assert observation.obstacles == ()


@pytest.mark.parametrize(
    ("leg", "reason"),
    [
        ("{kind: arc, radius_m: 8, angle_deg: 20, speed: 0.25}", NOT_TRAVELLED),
        ("{kind: turn, angle_deg: 20, rate_deg: 20}", ONLY_TURNED),
    ],
)
def test_a_turn_is_distinguished_from_the_drift_of_a_straight_drive(leg: str, reason: str) -> None:
    """The arc turns by at most 1.8 degrees a second."""
    course = f"observer: {{motion: {{kind: course, legs: [{leg}]}}}}\n"
    text = "based_on: static_turning\ntitle: x\nhelp: x\ncamera: {forward_m: 0.0}\n" + course
    source = SimulatedSource(World(scenario_from_text(text, "x"), 3))
    early = observe(read(source, 5), source.info.mount)[2:]
    assert {o.status for o in early} == {Status.DEGRADED}
    assert {o.reasons for o in early} == {(reason,)}


def test_the_right_image_does_not_change_the_result(
    seen: list[Observation], lateral: list[StereoFrame]
) -> None:
    rng = np.random.default_rng(1)
    noisy = [replace(f, right=rng.integers(0, 255, f.left.shape).astype(np.uint8)) for f in lateral]
    assert as_text(observe(noisy)) == as_text(seen)


def test_equal_input_gives_identical_results(
    seen: list[Observation], lateral: list[StereoFrame]
) -> None:
    assert as_text(observe(lateral)) == as_text(seen)


def test_one_camera_states_a_larger_uncertainty_than_two(seen: list[Observation]) -> None:
    source = SimulatedSource(LATERAL)
    frames = [source.read() for _ in range(COUNT)]
    observer = Observer(source.calibration, Parameters().changed({"ego_motion.model": "rigid"}))
    stereo = [observer.observe(f) for f in frames if f is not None]
    (one,), (two,) = seen[-1].reported, stereo[-1].reported
    for name in ("position_cov", "velocity_cov"):
        wide, narrow = getattr(one, name), getattr(two, name)
        assert np.trace(wide) > np.trace(narrow)


def test_the_method_recovers_from_black_images(lateral: list[StereoFrame]) -> None:
    dark = [
        replace(f, left=np.zeros_like(f.left), right=np.zeros_like(f.left)) for f in lateral[20:30]
    ]
    seen = observe([*lateral[:20], *dark, *lateral[30:]])
    assert seen[22].status is Status.LOST
    assert seen[22].T_world_camera is None
    assert seen[-1].segment > 0
    assert seen[-1].status is Status.OK
    assert seen[-1].T_world_camera is not None


def test_only_a_confirmed_track_has_a_permanent_number(seen: list[Observation]) -> None:
    numbers = {(o.id, o.state is TrackState.TENTATIVE) for each in seen for o in each.obstacles}
    assert {number for number, tentative in numbers if not tentative} == {1}
    provisional = {number for number, tentative in numbers if tentative}
    assert provisional
    assert max(provisional) < -1


def test_a_track_coasts_through_black_images_and_keeps_its_number(
    lateral: list[StereoFrame],
) -> None:
    dark = [
        replace(f, left=np.zeros_like(f.left), right=np.zeros_like(f.left)) for f in lateral[34:36]
    ]
    seen = observe([*lateral[:34], *dark, *lateral[36:]])
    (before,) = seen[33].reported
    for lost in seen[34:36]:
        assert lost.status is Status.LOST
        (robot,) = lost.reported
        assert (robot.id, robot.state) == (before.id, TrackState.COASTING)
        assert robot.position is None
        assert robot.velocity is None
        json.dumps(observation_line(lost), allow_nan=False)
    assert {o.segment for o in seen} == {0}
    (after,) = seen[-1].reported
    assert after.id == before.id
    assert after.state is TrackState.CONFIRMED
    assert after.position is not None


def test_any_pixel_can_be_explained(lateral: list[StereoFrame]) -> None:
    observer = Observer(SOURCE.calibration, ONE_CAMERA, mount=MOUNT)
    early = Observer(SOURCE.calibration, ONE_CAMERA, mount=None)
    for f in lateral[:40]:
        trace = FullTrace()
        observation = observer.observe(f, trace)
    (o,) = observation.reported
    u0, v0, u1, v1 = o.box_px
    answers = {
        explain_pixel(trace, observer.camera, ONE_CAMERA, (u, v)).verdict
        for u in np.linspace(u0, u1, 6)
        for v in np.linspace(v0, v1, 4)
    }
    assert PixelVerdict.DYNAMIC in answers
    for f in lateral[:3]:
        trace = FullTrace()
        early.observe(f, trace)
    answer = explain_pixel(trace, early.camera, ONE_CAMERA, (250.0, 120.0))
    assert answer.verdict is PixelVerdict.UNDECIDED
    assert "translation" in answer.sentence
