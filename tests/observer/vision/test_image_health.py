"""Image health: constructed faults are reported, and no built-in scene raises an alarm."""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from observer.camera import StereoCamera, as_gray
from observer.opening import open_source
from observer.parameters import FeaturesParameters, StereoParameters
from observer.simulation.imaging import StereoImager
from observer.simulation.scenarios import load_scenario, scenario_names
from observer.simulation.world import World
from observer.types import StereoFrame
from observer.vision.epipolar_error import EpipolarError, epipolar_error, epipolar_reason
from observer.vision.features import detect_features
from observer.vision.image_checks import exposure_reason, frozen_reason
from observer.vision.image_health import ImageHealth
from observer.vision.mismatch import mismatch_reason
from observer.vision.rectification import Rectification
from observer.vision.stereo import disparity_map, sample_disparity
from observer.vision.view import StereoRows, View

Pair = tuple[np.ndarray, np.ndarray]
MAX_DISPARITY_PX = StereoParameters().max_disparity_px
CAMERA = StereoCamera(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)
KITTI = ["kitti_static", "kitti_oncoming", "kitti_raw_unrectified"]
# Scenarios that declare wrong rows.
WRONG_ROWS = {"miscalibrated"}


@functools.cache
def scene(name: str) -> tuple[StereoCamera, tuple[Pair, ...]]:
    """Rectified grey pairs from the start, middle and end of a scenario."""
    world = World(load_scenario(name), 0)
    imager, rectification = StereoImager(world), Rectification(world.calibration)
    s = world.scenario
    pairs = []
    for index in (0, s.frame_count // 2, s.frame_count - 2):
        left, right = rectification.apply(*imager.pair(index, index / s.frame_rate))
        pairs.append((as_gray(left), as_gray(right)))
    return rectification.camera, tuple(pairs)


@pytest.fixture
def pair() -> Pair:
    return scene("lateral")[1][0]


def turned(image: np.ndarray, degrees: float) -> np.ndarray:
    """Clockwise on the screen, about the principal point."""
    M = cv2.getRotationMatrix2D((CAMERA.cx, CAMERA.cy), -degrees, 1.0)
    size = (image.shape[1], image.shape[0])
    return cv2.warpAffine(image, M, size, borderMode=cv2.BORDER_REFLECT)


def lowered(image: np.ndarray, rows: int) -> np.ndarray:
    if rows < 0:
        return lowered(image[::-1], -rows)[::-1]
    return cv2.copyMakeBorder(image, rows, 0, 0, 0, cv2.BORDER_REFLECT)[: image.shape[0]]


def noisy(image: np.ndarray, sigma: float = 3.0) -> np.ndarray:
    noise = np.random.default_rng(0).normal(0, sigma, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def with_gamma(image: np.ndarray, gamma: float) -> np.ndarray:
    return (255 * (image / 255.0) ** gamma).astype(np.uint8)


def measured_rows(pair: Pair, camera: StereoCamera) -> EpipolarError | None:
    """Row errors of features as sparse stereo finds them, by Lucas-Kanade from left to right."""
    left, right = pair
    px = detect_features(left, FeaturesParameters(max_count=300)).px
    start = sample_disparity(disparity_map(left, right, StereoParameters()), px)
    px, start = px[np.isfinite(start)], start[np.isfinite(start)]
    guess = px - np.stack([start, np.zeros_like(start)], axis=1).astype(np.float32)
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        left, right, px, guess, winSize=(15, 15), maxLevel=1, flags=cv2.OPTFLOW_USE_INITIAL_FLOW
    )
    kept = status[:, 0] > 0
    return epipolar_error(px[kept], px[kept, 1] - found[kept, 1], camera)


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


# --- exposure ------------------------------------------------------------------------------


def scaled(image: np.ndarray, gain: float) -> np.ndarray:
    return np.asarray(cv2.convertScaleAbs(image, alpha=gain), np.uint8)


@pytest.mark.parametrize(
    ("fault", "reported"),
    [
        (lambda image: scaled(image, 1.5), "right image is 1.6 times"),
        (lambda image: scaled(image, 0.6), "left image is 1.6 times"),
        (lambda image: with_gamma(image, 0.45), "right image is 1"),
        (lambda image: with_gamma(image, 1.8), "left image is"),
        (lambda image: noisy(np.zeros_like(image)), "right image is black"),
        (lambda image: np.full_like(image, 255), "right image is overexposed"),
        (lambda image: noisy(np.full_like(image, 90)), "right image is without any contrast"),
        (lambda image: cv2.GaussianBlur(image, (0, 0), 12), "right image has only"),
    ],
    ids=["brighter", "darker", "gamma up", "gamma down", "black", "white", "covered", "blurred"],
)
def test_fault_of_one_image_is_reported(
    pair: Pair, fault: Callable[[np.ndarray], np.ndarray], reported: str
) -> None:
    # Dark enough that brightening it saturates nothing.
    left, right = (scaled(image, 0.6) for image in pair)
    assert reported in (exposure_reason(left, fault(right)) or "")
    mirrored = reported.replace("right", "?").replace("left", "right").replace("?", "left")
    if "times" not in reported:
        assert mirrored in (exposure_reason(fault(left), right) or "")


@pytest.mark.parametrize("share", [0.6, 0.8, 1.0])
def test_light_through_fingers_counts_as_a_covered_lens(pair: Pair, share: float) -> None:
    left, right = pair
    glow = np.linspace(20, 120, right.size).reshape(right.shape)
    covered = right.copy()
    columns = int(share * right.shape[1])
    covered[:, :columns] = noisy(glow)[:, :columns]
    assert exposure_reason(left, covered) is not None


@pytest.mark.parametrize(
    ("gain", "share", "reported"),
    [(1.0, 0.8, False), (1.5, 0.8, True), (1.0, 0.4, True)],
    ids=["equal cameras", "unequal cameras", "little matched"],
)
def test_exposure_warning_ignores_a_close_person_if_matches_agree(
    pair: Pair, gain: float, share: float, reported: bool
) -> None:
    left, right = (scaled(image, 0.6) for image in pair)
    found = detect_features(left, FeaturesParameters(max_count=300)).px
    disparity = sample_disparity(disparity_map(left, right, StereoParameters()), found)
    px = found.astype(np.float64)
    # A person in light clothes, close to the right camera only, fills half of its image.
    half = right.shape[1] // 2
    close = scaled(right, gain)
    body = 160 + 6 * np.sin(np.arange(half) / 9.0) * np.ones((len(right), 1))
    close[:, :half] = noisy(gain * body, 1.0)
    disparity[px[:, 0] - disparity < half] = np.nan
    zeros = np.zeros(len(px))
    rows = StereoRows(px, zeros, disparity.astype(np.float64), zeros.astype(np.int64))
    view = View(0, 0.0, None, left, close)
    assert "times as bright" in (exposure_reason(left, close) or "")
    reasons = ImageHealth(scene("lab")[0]).look(view, StereoParameters(), share, rows)
    assert any("times as bright" in reason for reason in reasons) == reported


def test_two_black_images_give_one_reason(pair: Pair) -> None:
    dark = noisy(np.zeros_like(pair[0]), 2.0)
    assert (exposure_reason(dark, dark) or "").startswith("both images are black")


@pytest.mark.parametrize("gain", [0.6, 1.4])
def test_brightness_change_in_both_images_is_not_a_fault(pair: Pair, gain: float) -> None:
    assert exposure_reason(scaled(pair[0], gain), scaled(pair[1], gain)) is None


def test_images_of_any_size_can_be_judged() -> None:
    rng = np.random.default_rng(0)
    for shape in ((8, 8), (17, 33), (375, 1242), (1024, 1280)):
        image = rng.integers(30, 220, shape).astype(np.uint8)
        assert exposure_reason(image, image) is None
        assert mismatch_reason(image, image, 96) is None


# --- frozen --------------------------------------------------------------------------------


def test_frozen_camera_is_reported_until_one_pixel_changes(pair: Pair) -> None:
    left, right = pair
    next_left, next_right = scene("lateral")[1][1]
    assert frozen_reason(left, right, next_left, next_right) is None
    assert "the right image is" in (frozen_reason(left, right, next_left, right.copy()) or "")
    assert "the left image is" in (frozen_reason(left, right, left.copy(), next_right) or "")
    assert "both images are" in (frozen_reason(left, right, left, right) or "")
    touched = right.copy()
    touched[200, 300] ^= 1
    assert frozen_reason(left, right, next_left, touched) is None


def test_stationary_camera_at_a_static_scene_is_not_frozen(pair: Pair) -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        before, now = (
            [np.clip(image + rng.normal(0, 1, image.shape), 0, 255).astype(np.uint8)
             for image in pair]
            for _ in range(2)
        )  # fmt: skip
        assert frozen_reason(*before, *now) is None


# --- rows ----------------------------------------------------------------------------------


def rows_of(
    px: np.ndarray, shift: float, roll_deg: float, stretch: float, noise: float
) -> np.ndarray:
    """v_left - v_right when the right image is shifted down, rotated clockwise and stretched."""
    rng = np.random.default_rng(7)
    u, v = (px - (CAMERA.cx, CAMERA.cy)).T
    return -(shift + np.radians(roll_deg) * u + stretch * v) + rng.normal(0, noise, len(px))


@pytest.fixture
def places() -> np.ndarray:
    return np.random.default_rng(3).uniform((0, 0), (511, 255), (200, 2))


def test_shift_roll_and_stretch_are_separated_despite_outliers(places: np.ndarray) -> None:
    wrong = rows_of(places, 0.8, 0.4, 0.006, 0.2)
    wrong[:50] = np.random.default_rng(1).uniform(-20, 20, 50)
    error = epipolar_error(places, wrong, CAMERA)
    assert error is not None
    assert error.median_px == pytest.approx(-0.8, abs=0.25)
    assert np.degrees(error.roll_rad) == pytest.approx(0.4, abs=0.03)
    assert error.stretch == pytest.approx(0.006, abs=0.001)
    assert 140 <= error.count <= 165
    # RMS of the fitted plane over the image, from terms 0.8, 1.79 / sqrt 3 and 0.77 / sqrt 3.
    assert error.typical_px == pytest.approx(1.38, abs=0.08)
    assert 1.4 < error.p95_px < 3.5


def test_stated_deviation_matches_the_scatter() -> None:
    rng = np.random.default_rng(5)
    found, stated = [], []
    for _ in range(200):
        px = rng.uniform((0, 0), (511, 255), (60, 2))
        error = epipolar_error(px, 1.0 + rng.normal(0, 0.5, 60), CAMERA)
        assert error is not None
        found.append(error.typical_px)
        stated.append(error.typical_std_px)
    assert np.std(found) == pytest.approx(np.median(stated), rel=0.35)


def test_too_few_rows_give_no_error(places: np.ndarray) -> None:
    assert epipolar_error(places[:19], np.full(19, 5.0), CAMERA) is None
    unknown = np.full(len(places), np.nan)
    unknown[:19] = 5.0
    assert epipolar_error(places, unknown, CAMERA) is None
    assert epipolar_reason(None) is None
    assert epipolar_error(places[:20], np.full(20, 5.0), CAMERA) is not None


def test_few_noisy_rows_raise_no_alarm() -> None:
    rng = np.random.default_rng(2)
    alarms = 0
    for _ in range(200):
        px = rng.uniform((0, 0), (511, 255), (25, 2))
        alarms += epipolar_reason(
            epipolar_error(px, 0.8 + rng.normal(0, 1.0, 25), CAMERA)
        ) is not None  # fmt: skip
    assert alarms <= 4


def test_collinear_points_give_a_finite_error_and_no_alarm() -> None:
    px = np.stack([np.linspace(10, 500, 60), np.full(60, 40.0)], axis=1)
    noise = np.random.default_rng(0).normal(0, 0.2, 60)
    error = epipolar_error(px, noise, CAMERA)
    assert error is not None
    assert np.isfinite([error.typical_px, error.typical_std_px, error.roll_rad]).all()
    assert epipolar_reason(error) is None


@pytest.mark.parametrize(
    ("fault", "median_px", "roll_deg"),
    [
        (lambda image: lowered(image, 2), -2.0, 0.0),
        (lambda image: turned(image, 0.5), 0.0, 0.5),
        (lambda image: turned(lowered(image, 2), -0.5), -2.0, -0.5),
    ],
    ids=["2 rows", "0.5 deg", "both"],
)
@pytest.mark.parametrize("name", ["lateral", "low_texture_flicker", "turning"])
def test_row_errors_of_images_are_reported_with_numbers(
    name: str, fault: Callable[[np.ndarray], np.ndarray], median_px: float, roll_deg: float
) -> None:
    left, right = scene(name)[1][0]
    error = measured_rows((left, fault(right)), CAMERA)
    assert error is not None
    # Rotation shifts features off the centre, so the median depends on how they are distributed.
    assert error.median_px == pytest.approx(median_px, abs=0.25 if roll_deg == 0 else 0.8)
    assert np.degrees(error.roll_rad) == pytest.approx(roll_deg, abs=0.06)
    reported = epipolar_reason(error)
    assert reported is not None
    assert f"median {error.median_px:+.1f} px" in reported
    assert f"rotation {np.degrees(error.roll_rad):+.2f} deg" in reported
    assert "the limit is 1 px" in reported
    assert epipolar_reason(error, warn_px=4.0) is None


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
