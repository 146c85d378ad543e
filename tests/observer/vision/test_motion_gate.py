"""Jumps of the camera's motion: impossible ones are reported, rough driving is not."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from observer.geometry import Pose
from observer.opening import open_source
from observer.simulation.scenarios import scenario_names
from observer.vision.motion_gate import RECENT_MOTIONS, CameraMotion, ImageReach, jump_reason

RATE = 15.0
LAB = ImageReach(focal_px=443.0, depth_m=2.0, reach_px=60.0)
ROAD = ImageReach(focal_px=707.0, depth_m=10.0, reach_px=60.0)
# Pose standard deviations, rad and m: as measured in the lab and on the road, and much worse.
FINE, COARSE = (3e-4, 3e-3), (1e-3, 0.02)


def jumps(
    poses: list[Pose],
    times: np.ndarray,
    noise: tuple[float, float] = FINE,
    reach: ImageReach | None = LAB,
) -> list[str]:
    """The reasons given along ``T_world_camera`` poses; jumps do not enter the memory."""
    rng = np.random.default_rng(0)
    covariance = np.diag([noise[0] ** 2] * 3 + [noise[1] ** 2] * 3)
    recent: list[CameraMotion] = []
    reasons = []
    for k in range(1, len(times)):
        error = Pose.from_rotvec(rng.normal(0, noise[0], 3), rng.normal(0, noise[1], 3))
        measured = error @ poses[k].inverse() @ poses[k - 1]
        motion = CameraMotion.from_pose(times[k], times[k] - times[k - 1], measured, covariance)
        reason = jump_reason(motion, recent, reach)
        if reason is None:
            recent.append(motion)
        else:
            reasons.append(reason)
    return reasons


def along(
    place: Callable[[float], tuple[float, float, float]],
    turn: Callable[[float], tuple[float, float, float]],
    seconds: float = 6.0,
    rate: float = RATE,
) -> tuple[list[Pose], np.ndarray]:
    times = np.arange(0, seconds, 1 / rate)
    return [Pose.from_rotvec(turn(t), place(t)) for t in times], times


def dropped(
    poses: list[Pose], times: np.ndarray, share: float, seed: int = 1
) -> tuple[list[Pose], np.ndarray]:
    kept = np.random.default_rng(seed).random(len(times)) >= share
    return [pose for pose, keep in zip(poses, kept, strict=True) if keep], times[kept]


# --- rough driving -------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [FINE, COARSE])
@pytest.mark.parametrize("speed", [0.9, 3.0, 15.0])
def test_hardest_braking_is_not_a_jump(speed: float, noise: tuple[float, float]) -> None:
    stop = speed / 10.0

    def place(t: float) -> tuple[float, float, float]:
        braking = min(max(t - 1.0, 0.0), stop)
        return 0.0, 0.0, speed * min(t, 1.0) + speed * braking - 5.0 * braking**2

    assert jumps(*along(place, lambda _: (0, 0, 0)), noise, ROAD if speed > 5 else LAB) == []
    # Below 1 m/s, bumping into something stops the camera at once.
    if speed < 1:
        stopped = along(lambda t: (0, 0, speed * min(t, 1.0)), lambda _: (0, 0, 0))
        assert jumps(*stopped, noise) == []


@pytest.mark.parametrize("noise", [FINE, COARSE])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.6])
def test_turning_back_and_forth_is_not_a_jump(share: float, noise: tuple[float, float]) -> None:
    def turn(t: float) -> tuple[float, float, float]:
        # 20 deg/s, with an abrupt reversal every second.
        return 0.0, np.radians(20) * abs((t + 1) % 2 - 1), 0.0

    drive = along(lambda t: (0, 0, 0.3 * t), turn, 20.0)
    assert jumps(*dropped(*drive, share), noise) == []


@pytest.mark.parametrize("share", [0.0, 0.3, 0.6])
@pytest.mark.parametrize("hz", [7.0, 7.5, 9.0, 11.0])
def test_vibration_is_not_a_jump(hz: float, share: float) -> None:
    def turn(t: float) -> tuple[float, float, float]:
        angle = np.radians(0.25) * np.sin(2 * np.pi * hz * t)
        return angle, 0.5 * angle, -angle

    drive = along(lambda t: (0.002 * np.sin(2 * np.pi * hz * t), 0, 0.3 * t), turn)
    assert jumps(*dropped(*drive, share), COARSE) == []


@pytest.mark.parametrize("name", scenario_names())
def test_built_in_scenes_have_no_jumps(name: str) -> None:
    for seed in (0, 5):
        truth = open_source(f"simulated:{name}?seed={seed}").truth
        assert truth is not None
        times = np.arange(0, 10, 1 / RATE)
        poses = [truth.camera_pose(t) for t in times]
        assert all(poses)
        for noise in (FINE, COARSE):
            for share in (0.0, 0.5):
                assert jumps(*dropped(poses, times, share), noise) == []


@pytest.mark.parametrize("name", ["kitti_static", "kitti_oncoming"])
@pytest.mark.parametrize("share", [0.0, 0.4])
def test_kitti_drives_have_no_jumps(shared_data: Path, name: str, share: float) -> None:
    rows = np.loadtxt(shared_data / name / "poses.txt").reshape(-1, 3, 4)
    times = np.loadtxt(shared_data / name / "times.txt")
    poses = [Pose.from_matrix(row) for row in rows]
    assert jumps(*dropped(poses, times, share), (1e-3, 0.05), ROAD) == []


# --- explosions ----------------------------------------------------------------------------


def steady(count: int, speed: float = 0.3) -> list[CameraMotion]:
    return [
        CameraMotion.from_pose(
            k / RATE,
            1 / RATE,
            Pose.from_rotvec([0, 0.002, 0], [0, 0, -speed / RATE]),
            np.diag([1e-7] * 3 + [1e-5] * 3),
        )
        for k in range(count)
    ]


def after(recent: list[CameraMotion], step: Pose, std_m: float = 0.003) -> CameraMotion:
    covariance = np.diag([1e-7] * 3 + [std_m**2] * 3)
    return CameraMotion.from_pose(len(recent) / RATE, 1 / RATE, step, covariance)


@pytest.mark.parametrize("std_m", [0.003, 0.05, 1.0])
@pytest.mark.parametrize("metres", [0.3, 1.0, 5.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_large_step_in_one_frame_is_reported_with_numbers(
    axis: int, metres: float, std_m: float
) -> None:
    recent = steady(5)
    step = np.zeros(3)
    step[axis] = metres
    for reach in (LAB, None):
        reason = jump_reason(
            after(recent, Pose.from_rotvec(np.zeros(3), step), std_m), recent, reach
        )
        assert reason is not None
        assert "m/s within 0.067 s" in reason
        assert "is possible" in reason


def test_turn_too_fast_for_tracking_features_is_reported() -> None:
    recent = steady(5)
    step = Pose.from_rotvec([0, np.radians(10), 0], [0, 0, 0])
    reason = jump_reason(after(recent, step), recent, LAB)
    assert reason is not None
    assert "would shift the image" in reason
    assert "at most 60 px" in reason
    # Descriptor matching could find it; 30 deg in one frame is too much for any body.
    assert jump_reason(after(recent, step), recent, None) is None
    half_turn = Pose.from_rotvec([0, np.radians(30), 0], [0, 0, 0])
    assert "deg/s within" in (jump_reason(after(recent, half_turn), recent, None) or "")


def test_bump_of_a_tenth_of_a_metre_is_not_a_jump() -> None:
    recent = steady(5)
    step = Pose.from_rotvec(np.zeros(3), [0, 0, -0.3 / RATE - 0.1])
    assert jump_reason(after(recent, step), recent, LAB) is None


def test_uncertain_step_is_excused_and_a_certain_one_is_not() -> None:
    recent = steady(5)
    step = Pose.from_rotvec(np.zeros(3), [0.17, 0, 0])
    assert jump_reason(after(recent, step, std_m=0.002), recent, LAB) is not None
    assert jump_reason(after(recent, step, std_m=0.03), recent, LAB) is None


def test_best_fitting_recent_motion_decides() -> None:
    fast = [CameraMotion.from_pose(m.time, m.dt, Pose.from_rotvec([0, 0, 0], [0, 0, -1.0]), None)
            for m in steady(1)]  # fmt: skip
    step = Pose.from_rotvec(np.zeros(3), [0, 0, -1.0])
    slow = steady(5)[1:]
    assert len(slow) > RECENT_MOTIONS
    assert jump_reason(after(fast + slow, step), fast + slow, None) is not None
    mixed = fast + slow[: RECENT_MOTIONS - 1]
    assert jump_reason(after(mixed, step), mixed, None) is None


def test_only_impossible_motion_is_reported_without_history() -> None:
    for step, is_jump in ((1.5, False), (7.0, True)):
        motion = after([], Pose.from_rotvec(np.zeros(3), [0, 0, -step]))
        assert (jump_reason(motion, []) is not None) == is_jump
    # After a second without a motion, the last one is obsolete.
    late = CameraMotion.from_pose(3.0, 1 / RATE, Pose.from_rotvec(np.zeros(3), [0, 0, -1.0]), None)
    assert jump_reason(late, steady(3), LAB) is None


@pytest.mark.parametrize("dt", [0.0, -0.1, float("nan")])
def test_motion_needs_a_positive_duration(dt: float) -> None:
    with pytest.raises(ValueError, match="takes time"):
        CameraMotion.from_pose(1.0, dt, Pose.identity(), None)
