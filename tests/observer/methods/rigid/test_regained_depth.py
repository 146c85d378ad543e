"""Points keep their depth, or regain it, when a match in the right image is hard."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.methods.rigid.method import RigidMethod
from observer.parameters import Parameters
from observer.trace import NoTrace
from observer.vision.view import View

from ...builders import Texture, as_image

P = Parameters()
CAMERA = StereoCamera(320, 160, 250.0, 250.0, 160.0, 80.0, 0.12)
WALL = Texture(5, (160, 320))
DISPARITY_PX, DT, SKEW_S = 20.0, 0.1, 0.016


def view(
    index: int, left_px: float = 0.0, right_px: float = 0.0, right_time: float | None = None
) -> View:
    """The wall, moved in the left and, beyond its disparity, in the right image."""
    left, right = as_image(WALL.moved(left_px)), as_image(WALL.moved(right_px - DISPARITY_PX))
    return View(index, index * DT, right_time, left, right)


def shares(views: list[View]) -> list[float]:
    """The share of points with known depth, frame by frame."""
    method = RigidMethod(CAMERA, views[0], P)
    return [
        method.step(each, P, lambda _: nullcontext(), NoTrace()).stereo_share for each in views[1:]
    ]


def test_points_regain_depth_after_a_single_bad_right_image() -> None:
    views = [view(k) for k in range(14)]
    views[6] = replace(views[6], right=np.zeros_like(views[6].right))
    found = shares(views)
    assert found[5] < 0.2
    assert min(found[8:]) > 0.9


@pytest.mark.parametrize("flow_px_s", [0.0, 270.0, 450.0])
def test_points_keep_depth_in_fast_image_motion_with_a_known_skew(flow_px_s: float) -> None:
    # Slow at first, as a camera starts to turn.
    flow = np.minimum(np.arange(20) * 30.0, flow_px_s)
    at = np.cumsum(flow * DT)
    views = [view(k, at[k], at[k] + SKEW_S * flow[k], k * DT + SKEW_S) for k in range(len(at))]
    assert min(shares(views)[3:]) > 0.9
