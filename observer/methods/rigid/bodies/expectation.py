"""Prediction of bodies for the next frame, and how sure their velocities can be at best."""

from __future__ import annotations

import numpy as np

from observer.geometry import Float64Array
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import POSITION, VELOCITY, yaw_matrix
from observer.methods.rigid.bodies.membership import shape_position
from observer.methods.rigid.camera_step import CameraStep
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.parameters import EvidenceParameters, ObstacleParameters
from observer.types import TrackState
from observer.vision.lifecycle import NO_OBSTACLE

# Share of the acceleration that a steadily driving body may still have.
_STEADY = 0.1
# The same for a walking person.
_WALKING = 0.6
# m/s^2, one standard deviation of a reported person's acceleration, however near: close by, what
# accelerates little in the image may still walk along a curve.
_AGILE_MPS2 = 2.0
# Factor by which a reported person may accelerate more along the line of sight while no points on
# the trunk tell its distance: turning round is then noticed late, by a depth whose error lasts.
_UNSEEN_TURNS = 2.0
# m/s, one standard deviation of what a gait adds to a trunk's velocity for more than a frame.
_GAIT_MPS = 0.06
# rad/s^2, of a steady and of a manoeuvring body.
_YAW_ACCELERATION = (0.3, 5.0)
# A point seen at least this often knows its own motion, and needs no guess.
_YOUNG = 4


def predict(tracks: list[BodyTrack], now: CameraStep, parameters: ObstacleParameters) -> None:
    """Move all bodies on by one frame."""
    position, dt = now.position, now.dt
    for track in tracks:
        depth = float(np.linalg.norm(track.mean[POSITION] - position))
        agile = parameters.acceleration_px * depth / now.camera.fx
        steady, yaw_acceleration = _STEADY, _YAW_ACCELERATION
        axis = track.shape.axis(track.yaw)
        if not track.rigid:
            steady, yaw_acceleration = _WALKING, (0.0, 0.0)
            # What it learned while it counted as rigid is how a limb went.
            axis = None
        if not track.rigid and track.state is not TrackState.TENTATIVE:
            agile = max(agile, _AGILE_MPS2)
            if _depth_is_unmeasured(track):
                agile *= _UNSEEN_TURNS
                axis = (track.mean[POSITION] - position) / depth
        track.filter = track.filter.predicted(dt, (steady * agile, agile), yaw_acceleration, axis)
        track.by_points = False
        track.age_s += dt
        track.frames += 1
        track.steady_s += dt


def _depth_is_unmeasured(track: BodyTrack) -> bool:
    """Return whether nothing but a person's segment tells how far away the person is."""
    return not track.rigid and track.outline is not None and not track.outline.depths.measured


def note_lasting_errors(
    tracks: list[BodyTrack], now: CameraStep, parameters: EvidenceParameters
) -> None:
    """Note how sure velocities can be at best, seen from this pose.

    A body out of sight keeps what was noted when it was last seen.
    """
    for track in [t for t in tracks if t.missed_s == 0]:
        bias_px = parameters.disparity_bias_px
        outline = track.outline
        if outline is not None and _depth_is_unmeasured(track):
            bias_px = max(bias_px, outline.bias_px)
        place = now.T_camera_world.apply(track.mean[None, POSITION])
        velocity = now.T_camera_world.rotate(track.mean[None, VELOCITY])
        errors = now.rate.lasting_errors(
            place, velocity, now.camera, bias_px, parameters.distortion_sigma
        )
        drift = errors[0] @ now.T_camera_world.rotation
        gait = 0.0 if track.rigid else _GAIT_MPS
        track.lasting_cov = drift.T @ drift + gait**2 * np.eye(3)
        # Scatter would delay the decision whether a tentative track moves, and not improve it.
        if track.scatter is not None and track.state is not TrackState.TENTATIVE:
            noise = track.filter.covariance[VELOCITY, VELOCITY]
            track.lasting_cov += track.scatter.doubt(noise)


def expected_at(
    tracks: list[BodyTrack],
    points: TrackedPoints,
    place: Float64Array,
    dt: float,
    parameters: ObstacleParameters,
) -> Float64Array:
    """(N, 3) metres, world: where points on bodies should be in ``dt`` s; NaN for others.

    Points that are not members yet, but lie in a body's box, are expected to move with it.

    Args:
        place: (N, 3) metres, world, where points are now if they do not move.
    """
    out = np.full((len(points), 3), np.nan)
    young = np.flatnonzero((points.obstacle == NO_OBSTACLE) & (points.sightings < _YOUNG))
    for track in tracks:
        guests = young[track.contains(place[young], track.room(parameters.margin))]
        out[guests] = place[guests] + dt * track.velocity_at(place[guests])
        mine = np.flatnonzero(points.obstacle == track.id)
        R = yaw_matrix(track.yaw + dt * track.yaw_rate)
        origin = track.mean[POSITION] + dt * track.mean[VELOCITY]
        out[mine] = origin + shape_position(points, mine) @ R.T
    return out
