"""A room with two robots, known exactly: the observer's lines and the motion capture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from observer.geometry import Float64Array, Pose
from observer.mount import CameraMount
from observer.truth.alignment.time_offset import TimeOffset
from observer.truth.motion_capture import Capture, Trajectory

MOUNT = CameraMount(0.4, np.radians(8), 0.1, 0.05)
# The camera on the marker body: the markers are askew on the robot and not above its axle.
T_BODY_BASE = Pose.from_rotvec([0, 0, 0.6], [0.12, -0.08, -0.2])


def to_source(time: TimeOffset, times: Float64Array) -> Float64Array:
    """Convert truth's times to the source's clock, as ``TimeOffset`` describes it."""
    return times + time.offset_s + 1e-6 * time.drift_ppm * (times - time.reference_s)


def turn_z(angles: Float64Array) -> Float64Array:
    c, s = np.cos(angles), np.sin(angles)
    R = np.zeros((len(angles), 3, 3))
    R[:, 0, 0], R[:, 0, 1], R[:, 1, 0], R[:, 1, 1], R[:, 2, 2] = c, -s, s, c, 1
    return R


def observer_path(t: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return base (N, 3) and heading: waits, drives an arc, waits, drives on."""
    speed = 0.15 * (np.clip(t - 3, 0, 1) - np.clip(t - 14, 0, 1) + np.clip(t - 19, 0, 1))
    rate = 0.12 * (np.clip(t - 5, 0, 1) - np.clip(t - 11, 0, 1))
    dt = np.diff(t, prepend=t[0])
    heading = np.cumsum(rate * dt)
    steps = (speed * dt)[:, None] * np.column_stack([np.cos(heading), np.sin(heading), 0 * t])
    return np.cumsum(steps, axis=0), heading


def obstacle_path(t: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return centre (N, 3) and heading: to and fro with stops, turning round between."""
    moved = 0.35 * (np.clip(t - 2, 0, 5) - np.clip(t - 10, 0, 5.7) + np.clip(t - 20, 0, 4.1))
    # Smoothed, because robots accelerate gradually.
    kernel = np.ones(400) / 400
    moved = np.convolve(np.pad(moved, 200, mode="edge"), kernel, "same")[200:-200]
    turned = np.pi * (np.clip((t - 8) / 1.5, 0, 1) + np.clip((t - 17) / 1.5, 0, 1))
    return np.column_stack([3 + 0 * t, -1 + moved, 0.15 + 0 * t]), np.pi / 2 + turned


@dataclass(frozen=True, eq=False)
class Room:
    """``lines`` of the observer; ``capture``, whose times plus ``offset`` are the source's."""

    lines: list[dict[str, Any]]
    capture: Capture
    offset: float
    T_world_room: Pose
    T_body_camera: Pose
    centre: Callable[[float], Float64Array]
    speed: Callable[[float], float]


def make_room(
    seed: int = 0,
    *,
    offset: float = 0.3,
    noise: float = 0.004,
    segments: int = 1,
    observer: bool = True,
    drift_ppm: float = 0.0,
) -> Room:
    """Make one capture and one run of 26 s at 15 frames a second."""
    rng = np.random.default_rng(seed)
    fine = np.arange(0, 26, 1e-3)
    base, heading = observer_path(fine)
    place, facing = obstacle_path(fine)
    T_room_lab = Pose.from_rotvec([0, 0, rng.uniform(-3, 3)], [*rng.uniform(-3, 3, 2), 0])

    def at(values: Float64Array, t: Float64Array) -> Float64Array:
        index = np.clip(np.rint(t * 1000).astype(int), 0, len(fine) - 1)
        return np.asarray(values[index])

    # The observer's view; a new segment's world is the camera's pose where it begins.
    times = np.arange(0, 25.8, 1 / 15)
    T_lab_cameras = [
        Pose(turn_z(np.array([h]))[0], p) @ MOUNT.T_base_camera
        for p, h in zip(at(base, times), at(heading, times), strict=True)
    ]
    lines = []
    starts: dict[int, Pose] = {}
    for k, (t, T) in enumerate(zip(times, T_lab_cameras, strict=True)):
        segment = min(int(t / 26 * segments), segments - 1)
        T_world_lab = starts.setdefault(segment, T.inverse())
        pose = T_world_lab @ T
        lines.append(
            _line(k, float(t), segment, pose, T_world_lab.apply(at(place, times)[k]), rng, noise)
        )
    # The motion capture's view.
    own = np.arange(0, 25.9, 0.01) - offset + rng.uniform(0, 0.01)
    src = own + offset + 1e-6 * drift_ppm * (own - own.mean())
    origin = np.array([0.06, -0.2, 0.1])
    bodies = {
        "P3DX": _seen(
            "P3DX", own, at(place, src), at(facing, src), Pose(np.eye(3), origin), T_room_lab, rng
        )
    }
    if observer:
        T_base_body = T_BODY_BASE.inverse()
        bodies["Amigo"] = _seen(
            "Amigo", own, at(base, src), at(heading, src), T_base_body, T_room_lab, rng
        )
    rates = np.linalg.norm(np.gradient(place, fine, axis=0), axis=1)
    return Room(
        lines, Capture("planted", 100.0, bodies), offset, starts[0] @ T_room_lab.inverse(),
        T_BODY_BASE @ MOUNT.T_base_camera,
        lambda t: starts[0].apply(at(place, np.array([t]))[0]),
        lambda t: float(at(rates, np.array([t]))[0]),
    )  # fmt: skip


def _line(
    number: int, time: float, segment: int, pose: Pose, seen: Float64Array,
    rng: np.random.Generator, noise: float,
) -> dict[str, Any]:  # fmt: skip
    camera = pose.translation + rng.normal(0, 0.0005, 3)
    obstacle = {
        "id": 1,
        "state": "confirmed",
        "motion": "moving",
        "position": (seen + rng.normal(0, noise, 3)).tolist(),
        "velocity_time": time,
        "speed": 0.3,
        "speed_std": 0.03,
    }
    return {
        "frame": number,
        "time": time,
        "segment": segment,
        "pose": {
            "position": camera.tolist(),
            "orientation_wxyz": pose.quaternion_wxyz.tolist(),
        },
        # It is unknown for the first second.
        "obstacles": [obstacle] if time > 1 else [],
    }


def _seen(
    name: str, times: Float64Array, place: Float64Array, heading: Float64Array, T_thing_body: Pose,
    T_room_lab: Pose, rng: np.random.Generator,
) -> Trajectory:  # fmt: skip
    R = turn_z(heading)
    positions = T_room_lab.apply(place + R @ T_thing_body.translation)
    rotations = T_room_lab.rotation @ R @ T_thing_body.rotation
    positions = positions + rng.normal(0, 0.0005, positions.shape)
    for start in rng.integers(0, len(times), 3):
        positions[start : start + 25] = np.nan
        rotations[start : start + 25] = np.nan
    return Trajectory(name, times, positions, rotations)


@pytest.fixture(scope="session")
def room() -> Room:
    return make_room()


@pytest.fixture(scope="session")
def rooms() -> Callable[..., Room]:
    return make_room


@pytest.fixture(scope="session")
def mount() -> CameraMount:
    return MOUNT
