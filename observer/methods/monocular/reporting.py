"""Conversion of an obstacle on the ground to the reported one, with all its uncertainties."""

from __future__ import annotations

import numpy as np

from observer.geometry import Float64Array, Pose
from observer.methods.monocular.ground import GroundView
from observer.methods.monocular.ground_contact import shared_covariance, shared_velocity_covariance
from observer.methods.monocular.ground_track import GroundTrack
from observer.parameters import MonocularParameters
from observer.types import Obstacle, TrackState
from observer.vision.kinematics import closing_speed, speed_std
from observer.vision.lifecycle import out_of_sight

# Depth of an obstacle as a share of its width, and its standard deviation.
_DEPTH_SHARE, _DEPTH_SIGMA = 1.0, 0.3


def describe_ground_track(
    track: GroundTrack,
    view: GroundView,
    camera_velocity: Float64Array,
    scale_sigma: float,
    time: float,
    p: MonocularParameters,
) -> Obstacle:
    """Return one track as an obstacle at this frame.

    Args:
        camera_velocity: (3,) m/s, the camera's own, in its own axes. scale_sigma: of the distance
            it has travelled, as a share. time: of this frame, seconds.
    """
    ground, T_world_camera = view.ground, view.T_world_camera
    axes, tilt_sigma = ground.axes, float(np.radians(p.tilt_sigma_deg))
    camera_place = view.here
    camera_ground_velocity = axes.T @ T_world_camera.rotate(camera_velocity)
    gap = track.place - camera_place
    along = gap / max(float(np.linalg.norm(gap)), 1e-9)
    width, height = track.size
    place = track.place + _DEPTH_SHARE * width / 2 * along
    cov = track.covariance[:2, :2] + (_DEPTH_SIGMA * width) ** 2 * np.outer(along, along)
    cov = cov + shared_covariance(track.place, view, p.height_sigma, tilt_sigma)
    cov = cov + scale_sigma**2 * np.outer(camera_place, camera_place)
    velocity_cov = track.covariance[2:, 2:] + shared_velocity_covariance(
        track.place, track.velocity - camera_ground_velocity, view, p.height_sigma, tilt_sigma
    )
    velocity_cov = velocity_cov + scale_sigma**2 * np.outer(
        camera_ground_velocity, camera_ground_velocity
    )
    position = axes @ place + (ground.depth - height / 2) * ground.down
    velocity = axes @ track.velocity
    T_camera_world = T_world_camera.inverse()
    position_camera = T_camera_world.apply(position)
    velocity_camera = T_camera_world.rotate(velocity)
    speed = float(np.linalg.norm(velocity))
    # Obstacles do not leave the ground; vertical uncertainty is only that of the ground's flatness.
    upright = np.outer(ground.down, ground.down)
    R = np.column_stack([axes[:, 0], ground.down, axes[:, 1]])
    return Obstacle(
        id=track.id,
        state=track.state,
        motion=track.motion,
        position_camera=position_camera,
        velocity_camera=velocity_camera,
        position=position,
        velocity=velocity,
        position_cov=axes @ cov @ axes.T + (0.1 * height + 0.02) ** 2 * upright,
        velocity_cov=axes @ velocity_cov @ axes.T + 0.02**2 * upright,
        velocity_time=time,
        speed=speed,
        speed_std=speed_std(track.velocity, velocity_cov),
        size=np.array([width, height, _DEPTH_SHARE * width]),
        orientation_wxyz=Pose(R, np.zeros(3)).quaternion_wxyz,
        closing_speed=closing_speed(position_camera, velocity_camera, camera_velocity),
        points=track.points,
        significance=track.significance,
        box_px=track.box_px,
        reason=_why(track, speed),
    )


def _why(track: GroundTrack, speed: float) -> str:
    seen = (
        "its distance by parallax contradicts where it touches the ground"
        if track.floating
        else "its points do not stay on the epipolar lines of static points"
    )
    what = (
        f"{track.points} points: {seen} ({track.evidence:.1f} σ); its ground contact moves at "
        f"{speed:.2f} m/s, {track.significance:.1f} σ above zero"
    )
    if track.state is TrackState.COASTING:
        return out_of_sight(track.missed_s, what)
    return what
