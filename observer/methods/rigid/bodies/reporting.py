"""Conversion of a tracked body to the obstacle that is reported."""

from __future__ import annotations

import numpy as np

from observer.geometry import Float64Array, Pose
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import POSITION, yaw_matrix
from observer.types import MotionState, Obstacle, TrackState
from observer.vision.kinematics import closing_speed, speed_std
from observer.vision.lifecycle import out_of_sight

# The centre is known to this share of the box's size: its far side is not seen.
_CENTRE_SHARE = 0.15


def describe_body(
    track: BodyTrack, T_world_camera: Pose, camera_velocity: Float64Array, time: float
) -> Obstacle:
    """Return a body as an obstacle at this frame.

    Args:
        camera_velocity: (3,) m/s, the camera's own, in its own axes. time: of this frame, seconds.
    """
    velocity, velocity_cov = track.centre_velocity()
    T_camera_world = T_world_camera.inverse()
    position_camera = T_camera_world.apply(track.centre)
    velocity_camera = T_camera_world.rotate(velocity)
    size = np.zeros(3) if track.box is None else track.box.size
    R = track.R if track.box is None else track.R @ yaw_matrix(track.box.heading)
    position_cov = track.filter.covariance[POSITION, POSITION]
    position_cov = position_cov + R @ np.diag((_CENTRE_SHARE * size) ** 2) @ R.T
    speed = float(np.linalg.norm(velocity))
    return Obstacle(
        id=track.id,
        state=track.state,
        motion=track.motion,
        position_camera=position_camera,
        velocity_camera=velocity_camera,
        position=track.centre,
        velocity=velocity,
        position_cov=position_cov,
        velocity_cov=velocity_cov,
        velocity_time=time,
        speed=speed,
        speed_std=speed_std(velocity, velocity_cov),
        size=size,
        orientation_wxyz=Pose(R, np.zeros(3)).quaternion_wxyz,
        closing_speed=closing_speed(position_camera, velocity_camera, camera_velocity),
        points=track.points,
        significance=track.significance,
        box_px=track.box_px,
        reason=_why(track, speed),
        silhouette=None if track.outline is None else track.outline.silhouette,
    )


def _why(track: BodyTrack, speed: float) -> str:
    moving = track.motion is MotionState.MOVING
    if track.rigid:
        moves = "move at" if moving else "moved before and are now at rest:"
        subject = f"{track.points} feature points on one rigid body {moves}"
    else:
        moves = "moves at" if moving else "moved before and is now at rest:"
        if track.motion is MotionState.IN_PLACE:
            moves = "moves in place, like waving arms; its trunk:"
        subject = f"a depth segment with {track.points} feature points on it {moves}"
    what = (
        f"{subject} {speed:.2f} m/s, {track.significance:.1f} σ above zero, "
        f"tracked for {track.age_s:.1f} s"
    )
    if track.state is TrackState.COASTING:
        return out_of_sight(track.missed_s, what)
    return what
