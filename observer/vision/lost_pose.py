"""Obstacles at a frame whose pose is not known: they coast, and are nowhere in the world."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from observer.types import Obstacle, TrackState
from observer.vision.kinematics import out_of_sight


def without_pose(obstacle: Obstacle) -> Obstacle:
    """The same obstacle without all that only the camera's pose can tell."""
    return replace(
        obstacle,
        position=None,
        velocity=None,
        position_cov=None,
        velocity_cov=None,
        orientation_wxyz=None,
        closing_speed=None,
    )


def while_lost(
    last: Iterable[tuple[Obstacle, float]], elapsed_s: float, coast_s: float
) -> tuple[Obstacle, ...]:
    """Return the obstacles that are reported while nothing can be measured.

    The camera is taken to stand where it was last, for the sake of its own view alone; what has
    not been seen for longer than obstacles coast is left out.

    Args:
        last: each obstacle at the last frame whose pose is known, and for how many seconds it had
            not been seen by then.
        elapsed_s: seconds since that frame. coast_s: how long an obstacle is kept unseen.
    """
    return tuple(
        _unseen(obstacle, elapsed_s, missed_s + elapsed_s)
        for obstacle, missed_s in last
        if missed_s + elapsed_s <= coast_s
    )


def _unseen(obstacle: Obstacle, elapsed_s: float, missed_s: float) -> Obstacle:
    tentative = obstacle.state is TrackState.TENTATIVE
    why = obstacle.reason
    if obstacle.state is not TrackState.COASTING:
        why = out_of_sight(missed_s, f"before, {why}")
    return replace(
        without_pose(obstacle),
        state=TrackState.TENTATIVE if tentative else TrackState.COASTING,
        position_camera=obstacle.position_camera + elapsed_s * obstacle.velocity_camera,
        points=0,
        reason=why,
    )
