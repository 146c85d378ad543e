"""Conversion of a track to the reported obstacle: in the world and relative to the camera."""

from __future__ import annotations

from observer.geometry import Float64Array, Pose
from observer.methods.planar.results import Detection, Track
from observer.types import MotionState, Obstacle, TrackState
from observer.vision.kinematics import closing_speed, speed_std
from observer.vision.lifecycle import without_pose


def describe_obstacle(
    track: Track,
    T_track_camera: Pose,
    T_world_camera: Pose | None,
    camera_velocity: Float64Array | None,
    time: float,
) -> Obstacle:
    """Return one track as an obstacle at this frame.

    A coasting track keeps its last measured velocity and that velocity's time, while its
    position is extrapolated and grows less certain.

    Args:
        T_track_camera: the camera's pose in the tracking frame, always known.
        T_world_camera: the camera's pose; None where unknown, in which case the obstacle's
            position and velocity in the world are unknown too.
        camera_velocity: (3,) m/s, the camera's own, in its own axes; None where unknown.
        time: of this frame, seconds.
    """
    seen = track.detection
    T_camera_track = T_track_camera.inverse()
    position = T_camera_track.apply(track.position)
    velocity = T_camera_track.rotate(track.velocity)
    position_cov, velocity_cov = seen.position_cov, seen.velocity_cov
    if track.missed and velocity_cov is not None:
        position_cov = position_cov + (time - seen.velocity_time) ** 2 * velocity_cov
    R = T_track_camera.rotation
    std = None if seen.velocity_cov is None else speed_std(seen.velocity, seen.velocity_cov)
    approach = None
    if camera_velocity is not None:
        approach = closing_speed(position, velocity, camera_velocity)
    obstacle = Obstacle(
        id=track.id,
        state=track.state,
        motion=MotionState.MOVING,
        position_camera=position,
        velocity_camera=velocity,
        position=track.position,
        velocity=track.velocity,
        position_cov=R @ position_cov @ R.T,
        velocity_cov=None if velocity_cov is None else R @ velocity_cov @ R.T,
        velocity_time=seen.velocity_time,
        speed=seen.speed,
        speed_std=std,
        size=seen.size,
        orientation_wxyz=T_track_camera.quaternion_wxyz,
        closing_speed=approach,
        points=0 if track.missed else seen.points,
        significance=seen.significance,
        box_px=seen.box_px,
        reason=_why(track, seen),
    )
    return obstacle if T_world_camera is not None else without_pose(obstacle)


def _why(track: Track, seen: Detection) -> str:
    what = (
        f"{seen.points} points moved at {seen.speed:.2f} m/s, {seen.significance:.1f} σ above what "
        "a static surface would show there"
    )
    if track.state is TrackState.COASTING:
        return f"not seen for {track.missed} frames; before, {what}"
    return what
