"""The protective distance computed by hand, and obstacles carried along their own motion."""

from __future__ import annotations

import math

import numpy as np
import pytest

from observer.guard.outline import Outline, poses_along
from observer.guard.parameters import GuardParameters
from observer.guard.separation import Stopping, approach
from observer.guard.sight import SeenObstacle

P = GuardParameters(
    reaction_s=0.3, deceleration_mps2=0.5, turn_acceleration_radps2=2.0, margin_m=0.1, sigmas=2.0,
    slow_time_s=2.0,
)  # fmt: skip
BODY = Outline(0.4, 0.3, 0.25)
HERE = (0.0, 0.0, 0.0)


def thing(
    x: float, y: float = 0.0, vx: float = 0.0, vy: float = 0.0, sigma: float = 0.0
) -> SeenObstacle:
    return SeenObstacle(7, x, y, vx, vy, 0.2, sigma, sigma, False)


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("wanted", [(0.5, 0.0), (-0.2, 0.3), (0.0, 1.0)])
def test_share_within_inverts_way_s(share: float, wanted: tuple[float, float]) -> None:
    stopping = Stopping.of(*wanted, P)
    assert stopping.share_within(stopping.way_s(share)) == pytest.approx(share)
    end = np.array([[P.reaction_s + share * stopping.braking_s]])
    assert stopping.progress(np.array([[share]]), end)[0, 0] == pytest.approx(stopping.way_s(share))
    assert stopping.share_within(0.0) == 0.0
    assert stopping.share_within(100.0) == 1.0


def test_the_radius_of_an_arc_is_speed_over_turn_rate() -> None:
    quarter = poses_along(0.5, 0.25, np.array([math.pi / 0.5]))[0]
    assert quarter == pytest.approx([2.0, 2.0, math.pi / 2])
    assert poses_along(0.3, 0.0, np.array([2.0]))[0] == pytest.approx([0.6, 0.0, 0.0])


def test_a_static_obstacle_ahead_limits_by_the_protective_distance() -> None:
    # From the front to the thing's side: what S_p needs at 0.5 m/s, and 2 cm more or less.
    # Braking takes 1 s: reaction, braking, margin, and 5 % of the path at two standard deviations.
    needed = 0.15 + 0.25 + 0.1 + 2 * 0.05 * 0.4
    enough = approach([thing(0.2 + needed + 0.2 + 0.02)], HERE, 0.0, (0.5, 0.0), BODY, P)
    short = approach([thing(0.2 + needed + 0.2 - 0.02)], HERE, 0.0, (0.5, 0.0), BODY, P)
    assert enough.stop_share == 1.0
    assert 0.85 < short.stop_share < 1.0
    assert short.stopper == 7


def test_the_time_to_contact_includes_the_obstacles_own_motion() -> None:
    # 1.2 m between the sides, less a 0.1 m margin; 0.3 and 0.4 m/s towards each other.
    meets = approach([thing(1.6, vx=-0.4)], HERE, 0.0, (0.3, 0.0), BODY, P)
    assert meets.contact_s == pytest.approx(1.1 / 0.7, abs=0.1)
    assert meets.nearest == 7
    leads = approach([thing(1.0, vx=0.4)], HERE, 0.0, (0.3, 0.0), BODY, P)
    assert (leads.stop_share, leads.contact_s) == (1.0, None)


def test_an_obstacle_leaving_the_path_sideways_does_not_stop_the_robot() -> None:
    late = approach([thing(1.0, 0.9, vy=0.6)], HERE, 0.0, (0.3, 0.0), BODY, P)
    assert (late.stop_share, late.contact_s) == (1.0, None)
    into = approach([thing(1.0, 0.9, vy=-0.6)], HERE, 0.0, (0.3, 0.0), BODY, P)
    assert into.contact_s is not None


def test_more_uncertainty_lowers_the_stop_share() -> None:
    shares = [
        approach([thing(0.9, sigma=s)], HERE, 0.0, (0.5, 0.0), BODY, P).stop_share
        for s in (0.0, 0.05, 0.1)
    ]
    assert shares[0] > shares[1] > shares[2]


def test_an_old_sight_is_extrapolated_by_both_motions() -> None:
    # Seen 0.2 s ago from 0.1 m further back: by now it is where the fresh one is.
    fresh = approach([thing(1.2, vx=-0.5)], HERE, 0.0, (0.3, 0.0), BODY, P)
    old = approach([thing(1.4, vx=-0.5)], (-0.1, 0.0, 0.0), 0.2, (0.3, 0.0), BODY, P)
    assert old == fresh
    turned = approach(
        [thing(0.0, 1.2, vy=-0.5)], (0.0, 0.0, -math.pi / 2), 0.0, (0.3, 0.0), BODY, P
    )
    assert turned.contact_s == fresh.contact_s


@pytest.mark.parametrize("speed", [-0.3, 0.3])
def test_moving_away_is_always_allowed(speed: float) -> None:
    # Already inside the margin.
    near = approach([thing(-math.copysign(0.45, speed))], HERE, 0.0, (speed, 0.0), BODY, P)
    assert (near.stop_share, near.contact_s) == (1.0, None)
    towards = approach([thing(math.copysign(0.45, speed))], HERE, 0.0, (speed, 0.0), BODY, P)
    assert towards.stop_share == 0.0
