"""New points in images that were not exposed at the same time."""

from __future__ import annotations

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.geometry import Pose
from observer.methods.rigid import point_renewal
from observer.methods.rigid.point_renewal import PointRenewal
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.parameters import Parameters
from observer.vision.camera_rate import CameraRate
from observer.vision.view import View

from ...builders import Texture, as_image

CAMERA = StereoCamera(320, 160, 250.0, 250.0, 160.0, 80.0, 0.12)
WALL = Texture(5, (160, 320))
DISPARITY_PX = 20.0
SKEW_S = 0.016
# The camera slides along the wall, so that all of it moves uniformly in the image.
RATE = CameraRate(np.zeros(3), np.array([0.6, 0.0, 0.0]))
FLOW_PX_S = 0.6 * DISPARITY_PX / CAMERA.baseline


def new_points(right_time: float | None, rate: CameraRate | None) -> TrackedPoints:
    """Points of a wall that moves in the image before the right camera exposes."""
    seen_px = DISPARITY_PX - SKEW_S * FLOW_PX_S
    left, right = as_image(WALL.moved()), as_image(WALL.moved(-seen_px))
    view = View(0, 0.0, right_time, left, right)
    nothing, nowhere = TrackedPoints.none(), np.zeros((0, 4))
    renewal = PointRenewal(CAMERA)
    return renewal.renewed(nothing, view, nowhere, Pose.identity(), rate, Parameters(), 0.0)


def test_new_points_have_the_disparity_of_the_left_exposure() -> None:
    points = new_points(SKEW_S, RATE)
    assert len(points) > 30
    # The flow is computed from the disparity as seen, so a tenth of the skew error remains.
    assert np.median(points.disparity) == pytest.approx(DISPARITY_PX, abs=0.2)


@pytest.mark.parametrize(("right_time", "rate"), [(None, RATE), (0.0, RATE), (SKEW_S, None)])
def test_disparity_is_uncorrected_without_known_skew_or_motion(
    right_time: float | None, rate: CameraRate | None
) -> None:
    points = new_points(right_time, rate)
    expected = DISPARITY_PX - SKEW_S * FLOW_PX_S
    assert np.median(points.disparity) == pytest.approx(expected, abs=0.1)


@pytest.mark.parametrize("full", [False, True])
def test_points_on_the_wrong_surface_are_removed_even_if_no_cell_is_free(
    monkeypatch: pytest.MonkeyPatch, full: bool
) -> None:
    least = Parameters().evidence.min_sightings
    points = new_points(None, None)
    points = points.but(
        right_px=points.right_px - np.array([8.0, 0.0], np.float32),
        sightings=np.full(len(points), least, np.int64),
    )
    if full:
        none = np.zeros((0, 2), np.float32)
        monkeypatch.setattr(point_renewal, "new_keypoints", lambda *_: none)
    left, right = as_image(WALL.moved()), as_image(WALL.moved(-DISPARITY_PX))
    view, nowhere = View(0, 0.0, None, left, right), np.zeros((0, 4))
    kept = PointRenewal(CAMERA).renewed(
        points, view, nowhere, Pose.identity(), None, Parameters(), 0.0
    )
    assert len(points) > 30
    assert (kept.px[:, 0] - kept.right_px[:, 0] < DISPARITY_PX + 4.0).all()
