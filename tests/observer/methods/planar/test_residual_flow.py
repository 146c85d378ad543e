"""Residual flow after the transformation, on images with an independently moving patch."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from observer.methods.planar.residual_flow import residual_flow
from observer.parameters import FlowParameters


def scene(move: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """A static background and a moving patch (200..280, 100..160); noise in both images."""
    rng = np.random.default_rng(3)
    noise = rng.integers(0, 256, (2, 256, 512)).astype(np.uint8)
    background, patch = (
        cv2.normalize(cv2.GaussianBlur(n, (0, 0), 2), None, 20, 235, cv2.NORM_MINMAX) for n in noise
    )
    images = []
    for u, v in ((0, 0), move):
        shift = np.array([[1, 0, u], [0, 1, v]], np.float32)
        patch_here = np.zeros((256, 512), np.float32)
        patch_here[100:160, 200:280] = 1
        mask = cv2.warpAffine(patch_here, shift, (512, 256))
        moved = cv2.warpAffine(patch, shift, (512, 256), borderMode=cv2.BORDER_REFLECT)
        image = mask * moved + (1 - mask) * background + rng.normal(0, 1.5, mask.shape)
        images.append(np.clip(image, 0, 255).astype(np.uint8))
    return images[0], images[1]


GRID = np.stack(np.meshgrid(np.arange(8, 512, 12), np.arange(8, 256, 12)), -1).reshape(-1, 2)
POINTS = GRID.astype(np.float32)
ALL = np.ones((256, 512), bool)


def inside(px: np.ndarray, margin: float) -> np.ndarray:
    low, high = np.array([200, 100]) - margin, np.array([280, 160]) + margin
    return np.all((px >= low) & (px <= high), axis=1)


@pytest.mark.parametrize("move", [(4.0, 0.0), (-3.0, 2.5), (2.2, -0.4)])
def test_a_moving_patch_is_dynamic_with_its_own_motion(move: tuple[float, float]) -> None:
    flow = residual_flow(*scene(move), ALL, POINTS, FlowParameters())
    within = inside(flow.px, -12)
    assert within.sum() >= 10
    assert flow.dynamic[within].mean() > 0.9
    # Points at the edge of the patch see both motions.
    assert not flow.dynamic[~inside(flow.px, 16)].any()
    median = np.median(flow.residual_px[within], axis=0)
    np.testing.assert_allclose(median, move, atol=0.15)
    np.testing.assert_array_equal(flow.residual_px, flow.observed_px - flow.px)


def test_motion_below_the_threshold_is_static() -> None:
    first, second = scene((1.0, 0.0))
    assert not residual_flow(first, second, ALL, POINTS, FlowParameters()).dynamic.any()
    low = FlowParameters(residual_threshold_px=0.6)
    assert residual_flow(first, second, ALL, POINTS, low).dynamic.sum() >= 10


def test_points_near_the_border_of_the_valid_area_are_excluded() -> None:
    first, second = scene((4.0, 0.0))
    valid = ALL.copy()
    valid[:, 380:] = False
    valid[:30] = False
    second = np.where(valid, second, 0).astype(np.uint8)
    parameters = FlowParameters(window_px=15)
    flow = residual_flow(first, second, valid, POINTS, parameters)
    assert len(flow.px) > 100
    for px in (flow.px, flow.observed_px):
        assert (px[:, 0] <= 380 - 8).all()
        assert (px[:, 1] >= 30 + 7).all()
        assert (px >= 7).all()
    assert not flow.dynamic[~inside(flow.px, 16)].any()


def test_points_covered_at_t_dt_are_excluded() -> None:
    first, second = scene((0.0, 0.0))
    second[50:120, 350:450] = np.random.default_rng(0).integers(0, 256, (70, 100))
    flow = residual_flow(first, second, ALL, POINTS, FlowParameters())
    hidden = ((POINTS > (358, 58)) & (POINTS < (442, 112))).all(axis=1)
    kept = ((flow.px > (358, 58)) & (flow.px < (442, 112))).all(axis=1)
    assert kept.sum() <= 0.1 * hidden.sum()


@pytest.mark.parametrize(
    "points", [np.empty((0, 2), np.float32), np.array([[1, 1], [511, 255]], np.float32)]
)
def test_no_usable_point_gives_an_empty_flow(points: np.ndarray) -> None:
    flow = residual_flow(*scene((4.0, 0.0)), ALL, points, FlowParameters())
    assert len(flow.px) == 0
    assert flow.residual_px.shape == (0, 2)
    nowhere = residual_flow(*scene((4.0, 0.0)), ~ALL, POINTS, FlowParameters())
    assert len(nowhere.px) == 0


def test_no_point_on_a_straight_edge_is_followed() -> None:
    """Along an edge only the motion across it is observable; corners show all of it."""
    v, u = np.mgrid[0:256, 0:512]
    edges = (128 + 90 * np.sin((u + 0.3 * v) / 9)).astype(np.float64)
    rng = np.random.default_rng(0)
    first, second = (
        np.clip(edges + rng.normal(0, 2, edges.shape), 0, 255).astype(np.uint8) for _ in range(2)
    )
    anyhow = FlowParameters(min_texture=0.0, back_check_px=10.0)
    assert residual_flow(first, second, ALL, POINTS, anyhow).dynamic.sum() > 10
    checked = FlowParameters(back_check_px=10.0)
    assert not residual_flow(first, second, ALL, POINTS, checked).dynamic.any()
    assert len(residual_flow(*scene((0.0, 0.0)), ALL, POINTS, checked).px) > 500
