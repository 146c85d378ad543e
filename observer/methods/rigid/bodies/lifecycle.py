"""The life of one obstacle: whether it moves, when it is confirmed, when it ends."""

from __future__ import annotations

import numpy as np

from observer.methods.rigid.bodies.body import BodyTrack
from observer.parameters import ObstacleParameters
from observer.types import MotionState, TrackState
from observer.vision.lifecycle import expired, next_state

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
    """Judge whether a track moves, and whether it is confirmed, coasts or is seen again."""
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
    seen = track.missed_s == 0
    confirmed = seen and track.state is TrackState.TENTATIVE and _confirmed(track, parameters)
    track.state = next_state(track.state, seen=seen, confirmed=confirmed)


def is_over(track: BodyTrack, parameters: ObstacleParameters) -> bool:
    """Return whether a track is to end."""
    tentative = track.state is TrackState.TENTATIVE
    hopeless = tentative and track.age_s > _PATIENCE_S and track.hits == 0
    coast, patience = parameters.coast_s, _TENTATIVE_COAST_S
    return hopeless or expired(track.state, track.missed_s, coast=coast, patience=patience)


def _confirmed(track: BodyTrack, parameters: ObstacleParameters) -> bool:
    """Count this frame's evidence: a track must move significantly in enough frames and points.

    The fewer points there are, the longer they must keep moving alike.
    """
    moves = track.significance >= parameters.confirm_sigmas
    if moves and track.motion is MotionState.MOVING:
        track.hits += 1
        track.sightings += max(0, track.points - _ALIKE)
    else:
        track.hits = max(0, track.hits - 1)
    return track.hits >= parameters.confirm_hits and track.sightings >= _CONFIRM_SIGHTINGS
