"""Answers that do not depend on the method, and the rounding of figures."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.camera import StereoCamera
from observer.explanation import PixelVerdict, explain_pixel
from observer.explanation.answer import above, below
from observer.methods.planar.ego_motion import estimate_ego_motion
from observer.parameters import Parameters
from observer.types import Matches

CAMERA = StereoCamera(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)


@pytest.mark.parametrize("px", [(-1.0, 5.0), (512.0, 5.0), (5.0, -0.6), (5.0, 256.0)])
def test_outside_the_image(px: tuple[float, float]) -> None:
    answer = explain_pixel({}, CAMERA, Parameters(), px)
    assert answer.verdict is PixelVerdict.OUTSIDE
    assert "512 x 256" in answer.sentence
    assert "from 0 to 511" in answer.would_change


def test_a_non_finite_pixel_is_refused() -> None:
    with pytest.raises(ValueError, match="finite"):
        explain_pixel({}, CAMERA, Parameters(), (math.nan, 3.0))


def test_the_first_frame_is_undecided() -> None:
    answer = explain_pixel({"left": np.zeros((256, 512))}, CAMERA, Parameters(), (5.0, 5.0))
    assert answer.verdict is PixelVerdict.UNDECIDED
    assert "no earlier frame" in answer.sentence


def _lost(count: int, parameters: Parameters, *, follow: bool) -> dict[str, Any]:
    """A trace whose camera motion is estimated from ``count`` matches."""
    rng = np.random.default_rng(3)
    before = rng.uniform(20, 200, (count, 2)).astype(np.float32)
    after = before + 3 if follow else rng.uniform(20, 200, (count, 2)).astype(np.float32)
    matches = Matches(before, after)
    ego = estimate_ego_motion(matches, None, CAMERA, parameters.ego_motion, 0)
    return {"ego_motion": ego, "matches": matches}


def test_ego_motion_is_lost_with_too_few_matches_until_the_stated_value() -> None:
    parameters = Parameters().changed({"ego_motion.model": "affine"})
    answer = explain_pixel(_lost(7, parameters, follow=True), CAMERA, parameters, (5.0, 5.0))
    assert answer.verdict is PixelVerdict.EGO_MOTION_LOST
    assert answer.numbers == {"matches": 7, "min_inliers": 12}
    assert "min_inliers at 7 or below" in answer.would_change
    changed = parameters.changed({"ego_motion.min_inliers": 7})
    ego = _lost(7, changed, follow=True)["ego_motion"]
    assert ego.status.value != "lost"


def test_other_causes_of_lost_ego_motion_are_stated() -> None:
    parameters = Parameters().changed({"ego_motion.model": "affine"})
    scattered = explain_pixel(_lost(60, parameters, follow=False), CAMERA, parameters, (5.0, 5.0))
    assert scattered.verdict is PixelVerdict.EGO_MOTION_LOST
    assert "agree on one motion" in scattered.sentence
    assert "ego_motion.ransac_threshold_px" in scattered.would_change
    nothing = explain_pixel(_lost(2, parameters, follow=True), CAMERA, parameters, (5.0, 5.0))
    assert "No setting can help" in nothing.would_change


@given(st.floats(0.02, 500.0))
def test_rounded_figures_are_on_the_side_that_changes_the_answer(value: float) -> None:
    assert value - 0.0101 <= float(below(value)) <= value
    assert value <= float(above(value)) <= value + 0.0101
