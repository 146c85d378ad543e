"""What a lens sees, against its own forward projection."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
import pytest

from observer.calibration.fitting.lens import horizontal_field_of_view
from observer.camera import DistortionModel, StereoCalibration

WIDTH, HEIGHT = 640, 480


def rig(focal_px: float, D: Any, model: DistortionModel = "radtan") -> StereoCalibration:
    K = np.array([[focal_px, 0, 315.0], [0, focal_px, 244.0], [0, 0, 1.0]])
    D = np.asarray(D, float)
    return StereoCalibration(
        WIDTH, HEIGHT, K, D, K.copy(), D.copy(), np.eye(3), np.array([-0.1, 0, 0]), model
    )


def column_of(angle: float, c: StereoCalibration) -> float:
    """Where something at an angle from the axis, in the middle row, is seen."""
    place = np.array([[[math.tan(angle), (239.5 - c.K1[1, 2]) / c.K1[1, 1], 1.0]]])
    if c.distortion_model == "equidistant":
        seen = cv2.fisheye.projectPoints(place, np.zeros(3), np.zeros(3), c.K1, c.D1)[0]
    else:
        seen = cv2.projectPoints(place, np.zeros(3), np.zeros(3), c.K1, c.D1)[0]
    return float(seen.ravel()[0])


@pytest.mark.parametrize(
    ("model", "focal_px", "D"),
    [
        ("radtan", 500.0, (0.0,) * 5),
        ("radtan", 460.0, (-0.32, 0.11, 0.0, 0.0, -0.02)),
        ("equidistant", 300.0, (0.05, -0.01, 0.002, 0.0)),
    ],
)
def test_the_field_of_view_reaches_both_borders_through_the_lens(
    model: DistortionModel, focal_px: float, D: tuple[float, ...]
) -> None:
    c = rig(focal_px, D, model)
    # Beyond these angles, the polynomial of the second lens leads back into the image.
    angles = (
        np.linspace(-1.2, 1.2, 3001) if model == "equidistant" else np.linspace(-0.8, 0.8, 2001)
    )
    columns = np.array([column_of(angle, c) for angle in angles])
    inside = (columns > -0.5) & (columns < WIDTH - 0.5)
    assert not inside[[0, -1]].any()
    assert horizontal_field_of_view(c) == pytest.approx(np.ptp(angles[inside]), abs=0.002)


def test_a_lens_without_distortion_has_the_angle_of_its_focal_length() -> None:
    c = rig(500.0, np.zeros(5))
    assert math.degrees(horizontal_field_of_view(c)) == pytest.approx(65.2, abs=0.1)


def test_where_the_lens_model_ends_inside_the_image_distortion_is_left_out() -> None:
    c = rig(300.0, (0.8, -0.2, 0.1, 0.0), "equidistant")
    wide = rig(120.0, np.zeros(4), "equidistant")
    assert 0 < horizontal_field_of_view(c) < math.pi
    assert horizontal_field_of_view(wide) == pytest.approx(WIDTH / 120.0)
