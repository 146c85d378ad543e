"""Vergence against the wheels: a drive past points at known places, and rendered drives."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from observer.calibration.ageing.vergence import VergenceCheck, VergenceWatch
from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.mount import CameraMount
from observer.observer import Observer
from observer.simulation.scenarios import scenario_from_text
from observer.simulation.source import SimulatedSource
from observer.simulation.world import World
from observer.trace import FullTrace
from observer.types import Odometry
from observer.vision.vergence_fit import SeenTwice, distance_equation
from observer.vision.view import StereoRows

CAMERA = StereoCamera(640, 480, 500.0, 500.0, 319.5, 239.5, 0.12)
DT = 1 / 15


def room(seed: int = 0, near: float = 1.5, far: float = 9.0) -> Float64Array:
    """(400, 3) metres, world: points ahead."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(near, far, 400)
    return np.stack([z * rng.uniform(-0.6, 0.6, 400), z * rng.uniform(-0.45, 0.45, 400), z], 1)


def seen(
    points: Float64Array, T_world_camera: Pose, vergence: float, noise_px: float, seed: int = 0
) -> StereoRows:
    """Return what a pair finds if its right camera is turned towards the left one, rad."""
    rng = np.random.default_rng([seed, int(1e6 * T_world_camera.translation[2])])
    at = T_world_camera.inverse().apply(points)
    px, _ = CAMERA.project(at)
    turn = Pose.from_rotvec([0.0, vergence, 0.0], np.zeros(3))
    right = CAMERA.project(turn.apply(at - [CAMERA.baseline, 0, 0]))[0]
    px += rng.normal(0, noise_px, px.shape)
    disparity = px[:, 0] - right[:, 0] + rng.normal(0, noise_px, len(px))
    inside = ((px >= 0) & (px < (640, 480))).all(axis=1) & (at[:, 2] > 0.5)
    offset = rng.normal(0, 0.1, len(px))
    return StereoRows(px[inside], offset[inside], disparity[inside], np.flatnonzero(inside))


def drive(
    watch: VergenceWatch,
    vergence_deg: float,
    distance_m: float = 2.5,
    *,
    wheel_scale: float = 1.0,
    noise_px: float = 0.1,
    points: Float64Array | None = None,
    odometry: bool = True,
    seed: int = 0,
) -> VergenceCheck:
    """Drive straight ahead at 0.3 m/s; the stereo path has the scale error of a real method."""
    points = room(seed) if points is None else points
    vergence = np.deg2rad(vergence_deg)
    found = watch.add_frame(0.0, 0, None, None, None)
    for k in range(round(distance_m / 0.3 / DT)):
        z = 0.3 * DT * k
        rows = seen(points, Pose(np.eye(3), np.array([0, 0, z])), vergence, noise_px, seed)
        scale = 1 + vergence * 4 / CAMERA.baseline
        T_world_camera = Pose(np.eye(3), np.array([0.0, 0.0, scale * z]))
        wheels = Odometry(wheel_scale * z, 0.0, 0.0) if odometry else None
        found = watch.add_frame(k * DT, 0, rows, T_world_camera, wheels)
    return found


@pytest.mark.parametrize("vergence_deg", [-0.3, -0.1, 0.1, 0.3])
def test_one_noise_free_pair_gives_the_true_vergence(vergence_deg: float) -> None:
    v = np.deg2rad(vergence_deg)
    start, end = Pose.identity(), Pose.from_rotvec([0.01, 0.02, -0.01], [0.05, 0.01, 0.3])
    a, b = (seen(room(), pose, v, 0.0) for pose in (start, end))
    both = np.intersect1d(a.number, b.number)
    in_a, in_b = (np.searchsorted(rows.number, both) for rows in (a, b))
    distance_m = float(np.linalg.norm(end.translation))
    pair = SeenTwice(
        a.px[in_a], a.disparity[in_a], b.px[in_b], b.disparity[in_b],
        end.inverse(), distance_m / 1.02, 0.001,
    )  # fmt: skip
    equation = distance_equation(pair, CAMERA, (0.0, 0.0), 0.02)
    assert equation is not None
    vergence, scale = np.linalg.solve(equation.information, equation.vector)
    assert vergence == pytest.approx(v, abs=np.deg2rad(0.002))
    assert scale == pytest.approx(0.02, abs=0.002)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("vergence_deg", [-0.3, -0.1, 0.0, 0.1, 0.3])
def test_two_metre_drive_determines_vergence(vergence_deg: float, seed: int) -> None:
    scale = 1 + [0.0, 0.01, -0.01][seed]
    found = drive(VergenceWatch(CAMERA), vergence_deg, wheel_scale=scale, seed=seed)
    assert found.vergence_rad is not None
    assert found.std_rad is not None
    assert abs(found.vergence_rad - np.deg2rad(vergence_deg)) < 1.96 * found.std_rad
    assert found.std_rad < np.deg2rad(0.03)
    assert found.status == ("drifted" if vergence_deg else "consistent"), found.sentence
    if vergence_deg:
        assert ("converge more" if vergence_deg > 0 else "converge less") in found.sentence
        assert ("too far" if vergence_deg > 0 else "too near") in found.sentence
        assert "recalibrate" in found.sentence
    else:
        assert "the wheels confirm the calibrated vergence" in found.sentence
        assert not re.search(r"-0\.0+[° ]", found.sentence)


def test_wheel_scale_limits_certainty_when_all_points_are_equally_far() -> None:
    wall = room(near=7.9, far=8.1)
    found = drive(VergenceWatch(CAMERA), 0.0, 1.8, points=wall, noise_px=0.02)
    assert found.std_rad is not None
    # Vergence v for which f v is 1 % of the disparity.
    floor = 0.01 * CAMERA.baseline / 8.0
    # This comes on top of the uncertainty common to all disparities.
    assert found.std_rad**2 - (0.1 / CAMERA.fx) ** 2 > (0.9 * floor) ** 2


def test_missing_odometry_is_reported() -> None:
    found = drive(VergenceWatch(CAMERA), 0.3, odometry=False)
    assert found.status == "unobserved"
    assert found.vergence_rad is None
    assert found.std_rad is None
    assert "reports no wheel odometry" in found.sentence
    assert "drive 2 m straight ahead with wheel odometry" in found.sentence


def test_too_short_a_drive_is_reported() -> None:
    found = drive(VergenceWatch(CAMERA), 0.3, 0.3)
    assert found.status == "unobserved"
    assert "drive 2 m straight ahead" in found.sentence


def test_missing_stereo_matches_are_reported() -> None:
    watch = VergenceWatch(CAMERA)
    for k in range(30):
        found = watch.add_frame(k * DT, 0, None, Pose.identity(), Odometry(0.02 * k, 0, 0))
    assert found.status == "unobserved"
    assert "ego_motion.model" in found.sentence


@pytest.mark.parametrize("wheel_scale", [0.85, 1.2])
def test_wheel_slip_is_not_mistaken_for_vergence(wheel_scale: float) -> None:
    found = drive(VergenceWatch(CAMERA), 0.0, wheel_scale=wheel_scale)
    assert found.status == "unobserved"
    assert "slip" in found.sentence
    assert ("too little" if wheel_scale < 1 else "too much") in found.sentence


def test_new_segment_starts_a_new_pair_and_retains_the_estimate() -> None:
    watch = VergenceWatch(CAMERA)
    before = drive(watch, 0.3)
    rows = seen(room(7), Pose.identity(), 0.0, 0.1)
    # Point numbers and the world frame restart.
    for k, x in enumerate((3.0, 3.3)):
        found = watch.add_frame(20 + 2 * k, 1, rows, Pose.identity(), Odometry(x, 0, 0))
        rows = StereoRows(rows.px, rows.offset_px, rows.disparity, rows.number + 10_000)
    assert found.vergence_rad == before.vergence_rad


@pytest.mark.parametrize("calibrated_deg", [0.0, 0.15])
def test_simulated_drive_recovers_vergence(
    calibrated_deg: float, clip: Callable[[str, int], Any]
) -> None:
    frames = clip("simulated:turning?seed=1", 90).frames
    text = f"based_on: turning\nfaults: {{miscalibration: {{vergence_deg: {calibrated_deg}}}}}"
    source = SimulatedSource(World(scenario_from_text(text, "wrong"), 1))
    observer, info = Observer(source.calibration), source.info
    assert info.mount_height_m is not None
    assert info.mount_tilt_rad is not None
    mount = CameraMount(
        info.mount_height_m, info.mount_tilt_rad, info.mount_forward_m, info.mount_left_m
    )
    watch = VergenceWatch(observer.camera, mount)
    for frame in frames:
        trace = FullTrace()
        result = observer.observe(frame, trace)
        found = watch.add_frame(
            frame.time, result.segment, trace.get("rows"), result.T_world_camera, frame.odometry
        )
    assert found.vergence_rad is not None
    assert found.std_rad is not None
    # By as much as the calibration overstates vergence, the cameras converge less than it says.
    assert abs(found.vergence_rad + np.deg2rad(calibrated_deg)) < 2 * found.std_rad
    assert found.status == ("drifted" if calibrated_deg else "consistent")
