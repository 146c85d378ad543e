"""Conversion from the camera frame to the base frame, and which tracks count."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.guard.seeing import seen_obstacles, sight_of_observation
from observer.mount import CameraMount
from observer.types import MotionState, Observation, Obstacle, Status, TrackState, Unseen

from ..builders import an_obstacle

CAMERA = StereoCamera(640, 400, 500.0, 500.0, 319.5, 199.5, 0.12)
MOUNT = CameraMount(0.4, math.radians(5), 0.05, 0.06)


def obstacle(**changes: Any) -> Obstacle:
    given = {
        "position_camera": MOUNT.T_base_camera.inverse().apply(np.array([2.0, -0.5, 0.1])),
        "velocity_camera": MOUNT.R_base_camera.T @ np.array([0.1, 0.4, 0.0]),
        "position_cov": np.diag([0.01, 0.0025, 0.04]), "velocity_cov": np.diag([0.01] * 3),
        "size": np.array([0.6, 0.9, 0.8]),
    }  # fmt: skip
    return an_obstacle(**{**given, **changes})


def observation(*obstacles: Obstacle) -> Observation:
    return Observation(3, 1.0, 100.0, 0, Status.OK, (), 0, None, obstacles)


def test_positions_and_velocities_are_in_the_robot_frame() -> None:
    (seen,) = seen_obstacles(observation(obstacle()), CAMERA, MOUNT)
    assert (seen.x, seen.y) == pytest.approx((2.0, -0.5))
    assert (seen.vx, seen.vy) == pytest.approx((0.1, 0.4))
    # Half the diagonal on the floor plane; the height does not count.
    assert seen.radius_m == pytest.approx(0.5)
    assert seen.position_sigma_m == pytest.approx(0.2)
    assert seen.velocity_sigma_mps == pytest.approx(0.1)
    assert not seen.coasting


def test_unknown_uncertainties_stay_unknown() -> None:
    (seen,) = seen_obstacles(
        observation(obstacle(position_cov=None, velocity_cov=None)), CAMERA, MOUNT
    )
    assert (seen.position_sigma_m, seen.velocity_sigma_mps) == (None, None)


@pytest.mark.parametrize(
    ("changes", "counts"),
    [
        ({"state": TrackState.COASTING}, True),
        ({"motion": MotionState.STOPPED}, True),
        ({"state": TrackState.TENTATIVE, "significance": 4.5}, True),
        ({"state": TrackState.TENTATIVE, "significance": 3.0}, False),
        ({"state": TrackState.TENTATIVE, "significance": 9.0, "velocity_cov": None}, False),
    ],
)
def test_tentative_tracks_count_when_certain_enough(changes: dict[str, Any], counts: bool) -> None:
    seen = seen_obstacles(observation(obstacle(**changes)), CAMERA, MOUNT)
    assert len(seen) == counts
    if counts:
        assert seen[0].coasting == (changes.get("state") is TrackState.COASTING)


def test_no_obstacles_are_placed_without_a_mount() -> None:
    sight = sight_of_observation(observation(obstacle()), CAMERA, None, "real", None, 100.1)
    assert not sight.mount_known
    assert sight.obstacles == ()
    assert (sight.frame, sight.received, sight.published) == (3, 100.0, 100.1)
    assert sight.world == "real"


PLAIN = Unseen(0.3, {"plain": 0.3}, 16, ("ppp", "..."), hides_person=True)


@pytest.mark.parametrize(
    ("others", "status"), [((), Status.OK), (("the left image is blurred",), Status.DEGRADED)]
)
def test_unseen_regions_alone_do_not_make_a_frame_unfit_for_driving(
    others: tuple[str, ...], status: Status
) -> None:
    """The free scan does not cover them, and anything unknown counts as blocked."""
    seen = replace(
        observation(), status=Status.DEGRADED, reasons=(*others, *PLAIN.reasons), unseen=PLAIN
    )
    sight = sight_of_observation(seen, CAMERA, MOUNT, "real", None, 100.1)
    assert (sight.status, sight.reasons) == (status, others)


def test_a_frame_degraded_for_other_reasons_stays_degraded() -> None:
    seen = replace(observation(), status=Status.DEGRADED, reasons=("the right image is blurred",))
    sight = sight_of_observation(seen, CAMERA, MOUNT, "real", None, 100.1)
    assert sight.status is Status.DEGRADED
