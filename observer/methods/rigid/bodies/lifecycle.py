"""The life of one obstacle: whether it moves, when it is confirmed, when it ends."""

from __future__ import annotations

import numpy as np

from observer.methods.rigid.bodies.body import BodyTrack
from observer.parameters import ObstacleParameters
from observer.types import MotionState, TrackState

# Below this the velocity is no more than noise.
_MOVING_SIGMAS = 3.0
# The members that moved, beyond the first two, summed over the frames, before there is an
# obstacle: two or three on one edge err alike.
_CONFIRM_SIGHTINGS = 16
_ALIKE = 2
# Seconds: a tentative track that was not seen for so long, or has not moved significantly so long
# after it began, was none.
_TENTATIVE_COAST_S = 0.15
_PATIENCE_S = 0.5


def judge(track: BodyTrack, parameters: ObstacleParameters) -> None:
    """Decide whether a track moves, and whether it is confirmed, coasts or is seen again."""
    velocity, cov = track.centre_velocity()
    track.significance = float(np.sqrt(max(0.0, float(velocity @ np.linalg.solve(cov, velocity)))))
    speed = float(np.linalg.norm(velocity))
    direction = velocity / max(speed, 1e-9)
    sigma = float(np.sqrt(direction @ cov @ direction))
    limit = parameters.stopped_below_mps
    # Between the two conditions the answer stays what it was.
    if speed < limit or track.significance < _MOVING_SIGMAS:
        track.motion = MotionState.STOPPED
    elif speed - sigma > limit:
        track.motion = MotionState.MOVING
    if track.missed_s > 0:
        if track.state is TrackState.CONFIRMED:
            track.state = TrackState.COASTING
    elif track.state is TrackState.COASTING:
        track.state = TrackState.CONFIRMED
    elif track.state is TrackState.TENTATIVE:
        _confirm(track, parameters)


def over(track: BodyTrack, parameters: ObstacleParameters) -> bool:
    """Whether a track is to end."""
    if track.state is TrackState.TENTATIVE:
        hopeless = track.age_s > _PATIENCE_S and track.hits == 0
        return track.missed_s > _TENTATIVE_COAST_S or hopeless
    return track.missed_s > parameters.coast_s


def _confirm(track: BodyTrack, parameters: ObstacleParameters) -> None:
    """A tentative track is confirmed once it moved significantly in enough frames and points.

    The fewer points there are, the longer they must keep moving alike.
    """
    moves = track.significance >= parameters.confirm_sigmas
    if moves and track.motion is MotionState.MOVING:
        track.hits += 1
        track.sightings += max(0, track.points - _ALIKE)
    else:
        track.hits = max(0, track.hits - 1)
    if track.hits >= parameters.confirm_hits and track.sightings >= _CONFIRM_SIGHTINGS:
        track.state = TrackState.CONFIRMED
