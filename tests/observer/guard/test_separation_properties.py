"""Motions that an obstacle limits: all that bring the robot nearer than standing still would."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

from observer.geometry import Float64Array
from observer.guard.outline import Outline, poses_along
from observer.guard.parameters import GuardParameters
from observer.guard.separation import Stopping, approach
from observer.guard.sight import SeenObstacle

P = GuardParameters()
BODY = Outline(0.455, 0.381, 0.27)
HERE = (0.0, 0.0, 0.0)
# Share of the instants until the robot has braked. The guard looks at nine of them.
_LONG = 0.13

_METRES, _MPS, _SIGMAS = st.floats(-1.5, 1.5), st.floats(-1.2, 1.2), st.floats(0.0, 0.15)
_OBSTACLES = st.builds(
    SeenObstacle, st.just(7), _METRES, _METRES, _MPS, _MPS, st.sampled_from([0.0, 0.3]),
    _SIGMAS, _SIGMAS, st.just(False),
)  # fmt: skip
_MOTIONS = st.tuples(st.sampled_from([-0.3, 0.1, 0.3, 0.5]), st.floats(-0.6, 0.6))


def gaps(
    one: SeenObstacle, motion: tuple[float, float]
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return the gaps to an obstacle until the robot has braked, those to a standing robot, and
    the separation required; each (K,), metres."""
    stopping = Stopping.of(*motion, P)
    times = np.linspace(0.0, P.reaction_s + stopping.braking_s, 400)
    way = stopping.progress(np.ones((1, 1)), times[None])[0]
    driving, standing = (
        _gap(one, poses_along(*motion, each), times) for each in (way, np.zeros_like(way))
    )
    assert one.position_sigma_m is not None
    assert one.velocity_sigma_mps is not None
    sigma = np.hypot(one.position_sigma_m, one.velocity_sigma_mps * times)
    return driving, standing, P.margin_m + P.sigmas * sigma


def _gap(one: SeenObstacle, poses: Float64Array, times: Float64Array) -> Float64Array:
    dx, dy = one.x + one.vx * times - poses[:, 0], one.y + one.vy * times - poses[:, 1]
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    gap = BODY.distance(c * dx + s * dy, c * dy - s * dx)
    return np.asarray(gap + np.minimum(0.0, np.hypot(dx, dy) - BODY.width_m / 2) - one.radius_m)


@settings(max_examples=600)
@given(_OBSTACLES, _MOTIONS)
def test_nothing_is_approached_more_than_by_standing_still(
    one: SeenObstacle, motion: tuple[float, float]
) -> None:
    driving, standing, required = gaps(one, motion)
    near = (driving < required) & (driving < standing - 0.002)
    limited = approach([one], HERE, 0.0, motion, BODY, P)
    # Long enough for the guard to see it, whose instants are farther apart.
    if near.mean() > _LONG:
        event("approached")
        assert limited.stop_share < 1
        assert limited.stopper == 7
    elif limited.stop_share == 1:
        event("passed")


@pytest.mark.parametrize("speed", [0.1, 0.3, 0.5])
def test_whoever_crosses_ahead_of_a_standing_robot_limits_a_driving_one(speed: float) -> None:
    # From beside it, at constant bearing if it drives on.
    beside = SeenObstacle(7, 0.2, -0.8, speed, 0.5, 0.2, 0.05, 0.05, False)
    near = approach([beside], HERE, 0.0, (speed, 0.0), BODY, P)
    assert near.nearest == 7
    assert near.contact_s is not None
