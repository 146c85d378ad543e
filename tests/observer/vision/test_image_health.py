"""Image health: constructed faults are reported, and no built-in scene raises an alarm."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from observer.camera import as_gray
from observer.opening import open_source
from observer.parameters import StereoParameters
from observer.simulation.scenarios import scenario_names
from observer.types import StereoFrame
from observer.vision.epipolar_error import epipolar_reason
from observer.vision.image_checks import exposure_reason, frozen_reason
from observer.vision.image_health import ImageHealth
from observer.vision.mismatch import mismatch_reason
from observer.vision.rectification import Rectification
from observer.vision.view import StereoRows, View

from .image_pairs import (
    MAX_DISPARITY_PX,
    Pair,
    lowered,
    measured_rows,
    noisy,
    scene,
    turned,
    with_gamma,
)

KITTI = ["kitti_static", "kitti_oncoming", "kitti_raw_unrectified"]
# Scenarios that declare wrong rows.
WRONG_ROWS = {"miscalibrated"}


# --- no false alarm ------------------------------------------------------------------------


@pytest.mark.parametrize("name", scenario_names())
def test_built_in_scenes_raise_no_false_alarm(name: str) -> None:
    camera, pairs = scene(name)
    for left, right in pairs:
        # A settling exposure starts saturated, which is reported.
        assert exposure_reason(left, right) is None or name == "static_settling"
        assert mismatch_reason(left, right, MAX_DISPARITY_PX) is None or name in WRONG_ROWS
        rows = measured_rows((left, right), camera)
        assert rows is not None
        reported = epipolar_reason(rows)
        assert (reported is not None) == (name in WRONG_ROWS), reported
    for before, now in itertools.pairwise(pairs):
        assert frozen_reason(*before, *now) is None


@pytest.mark.parametrize("name", scenario_names())
def test_swapped_cameras_are_detected_in_every_built_in_scene(name: str) -> None:
    for left, right in scene(name)[1]:
        assert "swapped" in (mismatch_reason(right, left, MAX_DISPARITY_PX) or "")


@pytest.mark.parametrize("name", KITTI)
def test_road_raises_no_alarm_unless_swapped(shared_data: Path, name: str) -> None:
    source = open_source(str(shared_data / name)).source
    assert source.calibration is not None
    rectification = Rectification(source.calibration)
    for _ in range(4):
        frame = source.read()
        assert isinstance(frame, StereoFrame)
        left, right = map(as_gray, rectification.apply(frame.left, frame.right))
        assert exposure_reason(left, right) is None
        assert mismatch_reason(left, right, 128) is None
        assert mismatch_reason(right, left, 128) is not None
        assert epipolar_reason(measured_rows((left, right), rectification.camera)) is None


# --- swapped -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "fault",
    [
        lambda image: lowered(image, 2),
        lambda image: turned(image, 0.5),
        lambda image: with_gamma(image, 0.6),
        lambda image: cv2.GaussianBlur(image, (0, 0), 1.5),
    ],
    ids=["2 rows", "0.5 deg", "gamma", "blur"],
)
def test_other_faults_are_not_mistaken_for_a_swap_nor_hide_it(
    pair: Pair, fault: Callable[[np.ndarray], np.ndarray]
) -> None:
    left, right = pair
    assert "swapped" not in (mismatch_reason(left, fault(right), MAX_DISPARITY_PX) or "")
    assert "swapped" in (mismatch_reason(fault(right), left, MAX_DISPARITY_PX) or "")


@pytest.mark.parametrize("rows", [-12, -8, -4, 4, 8, 12])
def test_large_row_offsets_are_reported(pair: Pair, rows: int) -> None:
    left, right = pair
    reported = mismatch_reason(left, lowered(right, rows), MAX_DISPARITY_PX) or ""
    found = re.search(r"about (\d+) px:", reported)
    assert found is not None, reported
    assert int(found[1]) == abs(rows)


@pytest.mark.parametrize(
    ("fault", "cause"),
    [
        (lambda left, right: (right, left), "swapped"),
        (lambda left, right: (left, lowered(right, 4)), "about 4 px:"),
        (lambda left, right: (left, right), ""),
    ],
    ids=["swapped", "4 rows", "none"],
)
def test_cause_of_few_matches_is_reported(
    pair: Pair, fault: Callable[[np.ndarray, np.ndarray], Pair], cause: str
) -> None:
    """Nearly all of the few points that match by chance have a depth."""
    left, right = fault(*pair)
    few = StereoRows(np.full((15, 2), 50.0), np.zeros(15), np.full(15, 9.0), np.arange(15))
    health = ImageHealth(scene("lab")[0])
    for index in range(3):
        # Without the grain both cameras would count as frozen.
        grain = np.random.default_rng(index).integers(0, 2, left.shape, dtype=np.uint8)
        view = View(index, index / 15, None, left // 2 + grain, right // 2 + grain)
        reported = health.look(view, StereoParameters(), 0.9, few)
    assert cause in " ".join(reported)
    assert bool(reported) == bool(cause)


def test_swapped_cameras_stay_reported_until_cleared(pair: Pair) -> None:
    def rows(count: int) -> StereoRows:
        zeros = np.zeros(count)
        return StereoRows(np.full((count, 2), 50.0), zeros, zeros + 9.0, np.arange(count))

    def reported(index: int, pair: Pair, count: int) -> bool:
        grain = np.random.default_rng(index).integers(0, 2, pair[0].shape, dtype=np.uint8)
        view = View(index, index / 15, None, pair[0] // 2 + grain, pair[1] // 2 + grain)
        reasons = health.look(view, StereoParameters(), 0.9, rows(count))
        return any("swapped" in reason for reason in reasons)

    health = ImageHealth(scene("lab")[0])
    swapped = pair[::-1]
    assert reported(0, swapped, 15)
    # In every other frame enough points match by chance.
    assert all(reported(k, swapped, 60 - 30 * (k % 2)) for k in range(1, 25))
    cleared = [reported(k, pair, 60) for k in range(25, 40)]
    assert not any(cleared[10:])
    assert not reported(40, pair, 15)


@pytest.mark.parametrize("max_disparity_px", [16, 64, 128, 256])
def test_camera_order_is_checked_with_any_maximum_disparity(
    pair: Pair, max_disparity_px: int
) -> None:
    left, right = pair
    assert mismatch_reason(left, right, max_disparity_px) is None
    if max_disparity_px >= 64:
        assert mismatch_reason(right, left, max_disparity_px) is not None


def test_camera_order_is_not_judged_without_depth_or_texture(pair: Pair) -> None:
    left = pair[0]
    far = left[:, :480]
    assert mismatch_reason(far, far, 96) is None
    blank = np.full_like(left, 100)
    assert mismatch_reason(blank, blank, 96) is None
    assert mismatch_reason(noisy(blank), noisy(blank.T).T, 96) is None


def test_brightness_history_is_reset_when_time_goes_back(pair: Pair) -> None:
    health = ImageHealth(scene("lab")[0])
    for index, time in enumerate([0.0, 5.0, 9.9, 10.0, 0.0, 0.5, 0.9]):
        grain = np.random.default_rng(index).integers(0, 2, pair[0].shape, dtype=np.uint8)
        dark = 1 + index % 2
        view = View(index, time, None, pair[0] // dark // 2 + grain, pair[1] // dark // 2 + grain)
        assert not any("flickers" in each for each in health.look(view, StereoParameters()))
