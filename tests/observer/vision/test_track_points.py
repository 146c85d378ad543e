"""Tracking points from one image to another, and what is refused."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from observer.parameters import FlowParameters
from observer.vision.klt_tracking import track_points

SHIFT = np.array([3.25, -2.5])
GRID = np.stack(np.meshgrid(np.arange(20, 300, 20), np.arange(20, 180, 20)), -1)
POINTS = GRID.reshape(-1, 2).astype(np.float32)


def pair(gain: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """The second image is the first, shifted by SHIFT and brightened by a gain."""
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, (200, 320)).astype(np.uint8)
    first = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2), None, 20, 160, cv2.NORM_MINMAX)
    move = np.array([[1, 0, SHIFT[0]], [0, 1, SHIFT[1]]], np.float32)
    second = cv2.warpAffine(first, move, (320, 200), borderMode=cv2.BORDER_REFLECT)
    return first, cv2.convertScaleAbs(second, alpha=gain)


def test_points_are_tracked_to_their_new_positions() -> None:
    end, good = track_points(*pair(), POINTS, FlowParameters(), back_check=True)
    assert good.mean() > 0.95
    assert np.abs(end - POINTS - SHIFT)[good].max() < 0.2


@pytest.mark.parametrize("gain", [0.6, 1.4])
def test_flickering_light_is_not_motion(gain: float) -> None:
    end, good = track_points(*pair(gain), POINTS, FlowParameters(), back_check=True)
    assert good.mean() > 0.9
    assert np.percentile(np.abs(end - POINTS - SHIFT)[good], 95) < 0.3
    blind = FlowParameters(match_brightness=False)
    _, fewer = track_points(*pair(gain), POINTS, blind, back_check=True)
    assert fewer.sum() < 0.8 * good.sum()


@pytest.mark.parametrize("grey", [0, 90, 255])
def test_nothing_is_tracked_without_texture(grey: int) -> None:
    blank = np.full((200, 320), grey, np.uint8)
    _, good = track_points(blank, blank, POINTS, FlowParameters(), back_check=True)
    assert not good.any()
    _, good = track_points(pair()[0], blank, POINTS, FlowParameters(), back_check=True)
    assert not good.any()


def test_points_leaving_the_image_are_refused() -> None:
    near_edge = np.array([[318.0, 50.0], [100.0, 1.0], [150.0, 100.0]], np.float32)
    _, good = track_points(*pair(), near_edge, FlowParameters(), back_check=False)
    assert good.tolist() == [False, False, True]


def test_track_points_accepts_no_points() -> None:
    end, good = track_points(
        *pair(), np.empty((0, 2), np.float32), FlowParameters(), back_check=True
    )
    assert end.shape == (0, 2)
    assert good.shape == (0,)
