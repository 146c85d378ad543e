"""A camera on a wheeled robot with known motions, and one that the simulator drives."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from observer.geometry import Pose
from observer.mount import CameraMount
from observer.observer import Observer
from observer.rig.drive_estimate import (
    DRIVE_STRAIGHT,
    TURN_ON_THE_SPOT,
    DriveEstimate,
    estimate_drive,
)
from observer.rig.drive_stretches import DriveSample
from observer.rig.estimates import Estimated, Refused
from observer.simulation.scenarios import Scenario, load_scenario
from observer.simulation.source import SimulatedSource
from observer.simulation.world import World
from observer.types import Odometry

MOUNT = CameraMount(0.4, math.radians(8), 0.15, 0.06, roll_rad=0.02, pan_rad=math.radians(4))
TURN, BACK = ("turn", 60), ("turn", -60)
STRAIGHT = ("drive", 1.0)
FULL = (TURN, BACK, STRAIGHT)
Leg = tuple[str, float]


def driven(
    legs: Sequence[Leg],
    mount: CameraMount = MOUNT,
    wheel_scale: float = 1.0,
    turn_scale: float = 1.0,
    noise: float = 0.0,
    seed: int = 0,
) -> list[DriveSample]:
    """Samples at 15 Hz; the wheels report the distance and turn divided by their scales.

    ``noise``: of each step of the camera's path, metres; a fifth of that in radians.
    """
    rng = np.random.default_rng(seed)
    x = y = yaw = 0.0
    wheels = Odometry(0.0, 0.0, 0.0)
    T_world_base0 = mount.T_base_camera.inverse()
    off = Pose.identity()
    samples = [DriveSample(0.0, 0, Pose.identity(), wheels)]
    for kind, amount in legs:
        steps = 40
        distance = amount / steps if kind in ("drive", "arc") else 0.0
        turn = {"turn": math.radians(amount) / steps, "arc": distance / 0.6}.get(kind, 0.0)
        for _ in range(steps):
            x += distance * math.cos(yaw + turn / 2)
            y += distance * math.sin(yaw + turn / 2)
            yaw += turn
            heading = wheels.yaw + turn / turn_scale / 2
            wheels = Odometry(
                wheels.x + distance / wheel_scale * math.cos(heading),
                wheels.y + distance / wheel_scale * math.sin(heading),
                wheels.yaw + turn / turn_scale,
            )
            T_base0_base = Pose.from_rotvec([0, 0, yaw], [x, y, 0])
            T_world_camera = T_world_base0 @ T_base0_base @ mount.T_base_camera
            if noise:
                wobble = rng.standard_normal(6) * noise * np.array([0.2, 0.2, 0.2, 1, 1, 1])
                off = off @ Pose.from_rotvec(wobble[:3], wobble[3:])
            samples.append(DriveSample(len(samples) / 15, 0, T_world_camera @ off, wheels))
    return samples


def accepted(answer: DriveEstimate | Refused) -> DriveEstimate:
    assert isinstance(answer, DriveEstimate), answer
    return answer


def near(estimated: Estimated | None, value: float, within: float) -> None:
    assert estimated is not None
    assert estimated.value == pytest.approx(value, abs=within)


@pytest.mark.parametrize(
    "mount",
    [
        MOUNT,
        CameraMount(0.3, 0.0, -0.1, 0.0),
        CameraMount(0.3, -0.1, 0.2, -0.1, roll_rad=-0.1, pan_rad=-1.2),
        CameraMount(0.3, 0.1, -0.2, 0.0, pan_rad=math.pi - 0.1),
    ],
)
@pytest.mark.parametrize("legs", [FULL, (("arc", 0.7), STRAIGHT, TURN), (STRAIGHT, ("arc", -0.9))])
def test_exact_motions_give_the_exact_mount(mount: CameraMount, legs: tuple[Leg, ...]) -> None:
    estimate = accepted(estimate_drive(driven(legs, mount, wheel_scale=1.03, turn_scale=0.98)))
    assert estimate.still_needed == ()
    assert mount.forward_m is not None
    assert mount.left_m is not None
    near(estimate.forward_m, mount.forward_m, 5e-4)
    near(estimate.left_m, mount.left_m, 5e-4)
    near(estimate.pan_rad, mount.pan_rad, 1e-3)
    near(estimate.tilt_rad, mount.tilt_rad, 1e-3)
    near(estimate.roll_rad, mount.roll_rad, 1e-3)
    near(estimate.wheel_scale, 1.03, 1e-3)
    near(estimate.turn_scale, 0.98, 1e-3)


def test_most_errors_are_within_two_standard_deviations() -> None:
    deviations: dict[str, list[float]] = {}
    for seed in range(10):
        estimate = accepted(estimate_drive(driven(FULL, noise=0.0015, seed=seed)))
        for name in ("forward_m", "left_m", "pan_rad", "tilt_rad", "roll_rad"):
            value = getattr(estimate, name)
            assert value is not None
            off = (value.value - getattr(MOUNT, name)) / value.sigma
            deviations.setdefault(name, []).append(off)
    for name, offs in deviations.items():
        assert np.mean(np.abs(offs) < 2) >= 0.8, (name, offs)
        # Nor are the stated deviations uselessly wide.
        assert np.sqrt(np.mean(np.square(offs))) > 0.05, (name, offs)


def test_driving_straight_gives_pan_and_scale_and_requests_a_turn() -> None:
    estimate = accepted(estimate_drive(driven((STRAIGHT,), wheel_scale=1.02), MOUNT))
    assert (estimate.forward_m, estimate.left_m, estimate.tilt_rad) == (None, None, None)
    near(estimate.pan_rad, MOUNT.pan_rad, math.radians(0.2))
    near(estimate.wheel_scale, 1.02, 0.002)
    assert estimate.still_needed == (TURN_ON_THE_SPOT,)
    assert "still needed: turn on the spot by 60 degrees" in estimate.sentence


def test_a_turn_alone_gives_tilt_and_roll_and_requests_a_straight_drive() -> None:
    estimate = accepted(estimate_drive(driven((TURN, BACK))))
    assert (estimate.forward_m, estimate.pan_rad, estimate.wheel_scale) == (None, None, None)
    near(estimate.tilt_rad, MOUNT.tilt_rad, 1e-3)
    near(estimate.roll_rad, MOUNT.roll_rad, 1e-3)
    assert estimate.still_needed == (DRIVE_STRAIGHT,)


def test_a_small_turn_is_not_enough() -> None:
    estimate = accepted(estimate_drive(driven((STRAIGHT, ("turn", 20)), noise=0.001)))
    assert estimate.forward_m is None
    assert TURN_ON_THE_SPOT in estimate.still_needed


def test_standing_still_and_hardly_moving_are_refused() -> None:
    for legs in ((), (("wait", 0.0),), (("drive", 0.1),)):
        answer = estimate_drive(driven(legs))
        assert isinstance(answer, Refused)
        assert "hardly moved" in answer.sentence


def test_missing_odometry_and_a_lost_camera_are_reported() -> None:
    samples = driven(FULL)
    no_wheels = estimate_drive([replace(one, odometry=None) for one in samples])
    blind = estimate_drive([replace(one, T_world_camera=None) for one in samples])
    assert isinstance(no_wheels, Refused)
    assert isinstance(blind, Refused)
    assert "reports no wheel odometry" in no_wheels.sentence
    assert "ego-motion is unknown" in blind.sentence


def test_a_wrong_yaw_sign_and_wrong_units_are_reported() -> None:
    def with_wheels(x: float, yaw: float) -> DriveEstimate | Refused:
        samples = driven(FULL)
        odometry = [one.odometry or Odometry(0, 0, 0) for one in samples]
        return estimate_drive(
            [
                replace(s, odometry=Odometry(x * o.x, x * o.y, yaw * o.yaw))
                for s, o in zip(samples, odometry, strict=True)
            ]
        )

    wrong_sign, degrees, feet = with_wheels(1, -1), with_wheels(1, 0.5), with_wheels(3.28, 1)
    assert isinstance(wrong_sign, Refused)
    assert "positive to the left" in wrong_sign.sentence
    assert isinstance(degrees, Refused)
    assert "radians" in degrees.sentence
    assert isinstance(feet, Refused)
    assert "odometry is in metres" in feet.sentence


def test_segment_changes_lost_frames_and_odometry_resets_do_no_harm() -> None:
    samples = driven((*FULL, *FULL))
    moved = Pose.from_rotvec([0.3, 1.0, 0.0], [4.0, 1.0, 2.0])
    for k in range(70, len(samples)):
        pose = samples[k].T_world_camera
        assert pose is not None
        samples[k] = replace(samples[k], segment=1, T_world_camera=moved @ pose)
    for k in range(150, len(samples)):
        odometry = samples[k].odometry
        assert odometry is not None
        samples[k] = replace(samples[k], odometry=replace(odometry, x=odometry.x - 50))
    for k in (20, 21, 90):
        samples[k] = replace(samples[k], T_world_camera=None)
    estimate = accepted(estimate_drive(samples))
    near(estimate.forward_m, 0.15, 5e-4)
    near(estimate.left_m, 0.06, 5e-4)
    near(estimate.wheel_scale, 1.0, 1e-3)


def test_wheel_slip_hardly_affects_the_estimate() -> None:
    samples = driven((TURN, BACK, STRAIGHT, STRAIGHT), noise=0.0003)
    slipped = samples[:100]
    for sample in samples[100:]:
        assert sample.odometry is not None
        further = replace(sample.odometry, x=sample.odometry.x + 0.2)
        slipped.append(replace(sample, odometry=further))
    estimate = accepted(estimate_drive(slipped))
    near(estimate.forward_m, 0.15, 0.01)
    near(estimate.wheel_scale, 1.0, 0.02)


def test_the_floor_estimate_is_taken_into_account() -> None:
    arc = driven((("arc", 0.5), STRAIGHT), noise=0.004)
    alone, together = accepted(estimate_drive(arc)), accepted(estimate_drive(arc, MOUNT, 0.002))
    assert alone.tilt_rad is not None
    assert together.tilt_rad is not None
    assert together.tilt_rad.sigma < alone.tilt_rad.sigma
    near(together.tilt_rad, MOUNT.tilt_rad, 0.005)


@pytest.mark.slow
@pytest.mark.patient
def test_the_mount_of_a_simulated_robot_is_estimated() -> None:
    legs = [
        {"kind": "turn", "angle_deg": -30, "rate_deg": 60},
        {"kind": "turn", "angle_deg": 60, "rate_deg": 60},
        {"kind": "turn", "angle_deg": -30, "rate_deg": 60},
        {"kind": "drive", "distance_m": 0.8, "speed": 0.5},
    ]
    spec = load_scenario("lab").model_dump()
    spec["observer"] = {"motion": {"kind": "course", "legs": legs}}
    spec["shake"] = {"yaw": {"amplitude": 4, "period_s": 1000, "phase_deg": 90}}
    spec["camera"] |= {"forward_m": 0.15, "tilt_deg": 8}
    spec["duration_s"] = 5
    source = SimulatedSource(World(Scenario.model_validate(spec), 1))
    observer = Observer(source.calibration)
    samples = []
    while (frame := source.read()) is not None:
        seen = observer.observe(frame)
        samples.append(DriveSample(seen.time, seen.segment, seen.T_world_camera, frame.odometry))
    estimate = accepted(estimate_drive(samples))
    assert estimate.still_needed == ()
    near(estimate.forward_m, 0.15, 0.015)
    near(estimate.left_m, 0.06, 0.015)
    near(estimate.pan_rad, math.radians(4), math.radians(0.6))
    near(estimate.tilt_rad, math.radians(8), math.radians(0.4))
    near(estimate.wheel_scale, 1.0, 0.04)
