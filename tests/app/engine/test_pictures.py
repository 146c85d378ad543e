"""Views and calibration previews, from a hand-made trace."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from app.contract.views import CAMERA_NAMES, VIEW_NAMES
from app.engine.calibration_preview import preview_calibration, vertical_error
from app.engine.dense_stereo import PairKeeper, dense_stereo
from app.engine.observed import Observed
from app.engine.views import MAX_WIDTH, draw_disparity, draw_view
from observer.calibration.boards.board import Board
from observer.calibration.formats.opencv_file import calibration_text
from observer.camera import StereoCalibration, StereoCamera
from observer.errors import CalibrationError
from observer.geometry import Pose
from observer.parameters import Parameters
from observer.simulation.scenarios import load_scenario
from observer.simulation.source import SimulatedSource
from observer.simulation.world import World
from observer.types import (
    Image,
    Matches,
    Observation,
    Obstacle,
    Status,
    StereoFrame,
    Unseen,
)

from ...observer.builders import an_obstacle

WIDTH, HEIGHT = 320, 200
CAMERA = StereoCamera(WIDTH, HEIGHT, 200.0, 200.0, 160.0, 100.0, 0.1)


class Ego:
    """Of three matches the last one is on a moving object."""

    inliers = np.array([True, True, False])


def scene(width: int = WIDTH, height: int = HEIGHT, seed: int = 0) -> np.ndarray[Any, Any]:
    noise = np.random.default_rng(seed).integers(0, 256, (height // 4, width // 4), dtype=np.uint8)
    return cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC)


def obstacle() -> Obstacle:
    return an_obstacle(
        id=12,
        box_px=(200.0, 60.0, 280.0, 150.0),
        silhouette=(np.array([[220.0, 70.0], [260.0, 70.0], [260.0, 140.0], [220.0, 140.0]]),),
    )


def observed(
    index: int = 1,
    *,
    full: bool = True,
    gray: bool = True,
    width: int = WIDTH,
    height: int = HEIGHT,
) -> Observed:
    # Plain grey with a lighter stripe below, so that every colour found in it was drawn.
    left: Image = np.full((height, width), 90, np.uint8)
    left[-30:] = 180
    if not gray:
        left = np.asarray(cv2.cvtColor(left, cv2.COLOR_GRAY2BGR), np.uint8)
    trace: dict[str, Any] = {"left": left}
    if full:
        previous = np.array([[40, 40], [80, 120], [220, 100]], np.float32)
        disparity = np.full((height, width), 10.0, np.float32)
        disparity[:, : width // 4] = np.nan
        trace |= {
            "previous_time": (index - 1) / 10,
            "previous_left": left if gray else left[..., 0],
            "matches": Matches(previous, previous + np.array([6, 0], np.float32)),
            "ego_motion": Ego(),
            "warped_left": scene(width, height, seed=1),
            "disparity": disparity,
            "flow_px": previous,
            "flow_residual_px": np.array([[0.1, 0], [0.2, 0.1], [5, 0]], np.float32),
            "dynamic": np.array([False, False, True]),
        }
    reasons = () if full else ("first frame",)
    pose = Pose(np.eye(3), np.array([0, 0, 0.1 * index]))
    frame = StereoFrame(index, index / 10, left, left, received=50.0 + index)
    observation = Observation(
        index, frame.time, frame.received, 0, Status.OK, reasons, 1, pose, (obstacle(),)
    )
    return Observed(frame, observation, trace, CAMERA, Parameters(), 0)


def drawn(name: str, what: Observed) -> bytes:
    if name != "disparity":
        return draw_view(name, what)
    keeper = PairKeeper()
    keeper.remember(observed(0))
    pair = keeper.pair(what)
    return draw_disparity(pair, dense_stereo(pair))


def picture(name: str, what: Observed) -> np.ndarray[Any, Any]:
    image = cv2.imdecode(np.frombuffer(drawn(name, what), np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return image.astype(int)


def near(image: np.ndarray[Any, Any], at: tuple[int, int], bgr: tuple[int, int, int]) -> bool:
    """Return whether a colour is found within two pixels of (u, v), as far as JPEG preserves it."""
    u, v = at
    patch = image[v - 2 : v + 3, u - 2 : u + 3].reshape(-1, 3)
    return bool((np.abs(patch - bgr).max(axis=1) < 90).any())


@pytest.mark.parametrize("gray", [True, False])
def test_the_left_view_draws_features_flow_and_boxes_on_a_copy(gray: bool) -> None:
    what = observed(gray=gray)
    before = what.trace["left"].copy()
    image = picture("left", what)
    assert near(image, (200, 100), (44, 44, 226)), "the rectangle's left edge is red"
    assert near(image, (46, 40), (60, 220, 60)), "a star marks the feature now"
    assert near(image, (222, 100), (40, 140, 255)), "an outlier's flow is orange"
    assert np.array_equal(what.trace["left"], before)
    assert near(image, (220, 120), (44, 44, 226)), "so is the silhouette's"
    blue, green, red = image[130, 240]
    assert red > 110 > 90 > max(blue, green), "within it the grey is tinted"
    assert np.ptp(image[65, 240]) < 25, "between it and the box it is not"


def test_unknown_disparity_stays_dark() -> None:
    image = picture("disparity", observed())
    assert image[20:-20, 10 : WIDTH // 4 - 10].max() < 60
    assert image[20:-20, WIDTH // 4 + 20 :].max(axis=2).min() > 100


def test_only_dynamic_residuals_are_red() -> None:
    image = picture("residual", observed())
    assert near(image, (230, 100), (60, 60, 255))
    assert not near(image, (40, 40), (60, 60, 255))


def test_the_plain_and_warped_views_show_the_images() -> None:
    what = observed()
    for name, key in (("plain", "left"), ("warped", "warped_left")):
        difference = np.abs(picture(name, what)[..., 0] - what.trace[key].astype(int))
        assert np.median(difference) < 12


@pytest.mark.parametrize("name", [name for name in VIEW_NAMES if name not in CAMERA_NAMES])
def test_every_view_has_an_image_even_for_a_first_frame(name: str) -> None:
    image = picture(name, observed(full=False))
    assert image.shape == (HEIGHT, WIDTH, 3)
    if name in ("warped", "disparity", "residual"):
        assert np.median(image) < 40, "it says that there is nothing"
        assert image.max() > 100


def test_a_warped_view_without_an_image_names_the_model() -> None:
    first = observed(full=False)
    pictures = []
    for model in ("rigid", "monocular", "affine"):
        parameters = Parameters().changed({"ego_motion.model": model})
        pictures.append(picture("warped", replace(first, parameters=parameters)))
    lit = [int((image.max(axis=2) > 90).sum()) for image in pictures]
    assert not np.array_equal(pictures[0], pictures[1])
    # Affine just has no image yet in a first frame; the other models' sentence takes two lines.
    assert min(lit[:2]) > lit[2] > 0


def test_wide_images_are_shrunk() -> None:
    assert picture("plain", observed(width=2560)).shape == (HEIGHT // 2, MAX_WIDTH, 3)


def rectified() -> StereoCalibration:
    return StereoCalibration.rectified(WIDTH, HEIGHT, 200, 200, 160, 100, 0.1)


@pytest.mark.parametrize("rows", [0, 3])
def test_the_preview_measures_the_vertical_row_error(rows: int) -> None:
    left = scene()
    right = np.roll(np.roll(left, -8, axis=1), rows, axis=0)
    frame = StereoFrame(0, 0.0, left, right, received=0.0)
    beats: list[int] = []
    preview = preview_calibration(frame, calibration_text(rectified()), lambda: beats.append(1))
    assert preview.matches > 50
    assert preview.vertical_error_px == pytest.approx(rows, abs=0.3)
    assert len(beats) >= 2
    image = cv2.imdecode(np.frombuffer(preview.jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    assert image.shape == (HEIGHT, 2 * WIDTH, 3)


def test_without_matches_the_error_is_none_instead_of_zero() -> None:
    empty = np.zeros((HEIGHT, WIDTH), np.uint8)
    assert vertical_error(empty, empty) == (None, 0)


def test_a_preview_with_a_different_image_size_is_refused() -> None:
    frame = StereoFrame(0, 0.0, scene(640, 480), scene(640, 480), received=0.0)
    with pytest.raises(CalibrationError, match="640x480"):
        preview_calibration(frame, calibration_text(rectified()), lambda: None)


@pytest.mark.parametrize("shift_px", [0.0, 0.3, 1.2])
def test_vertical_errors_are_measured_to_subpixel_accuracy(shift_px: float) -> None:
    noise = np.random.default_rng(3).integers(0, 256, (200, 320)).astype(np.uint8)
    left = np.asarray(cv2.GaussianBlur(noise, (0, 0), 2.0), np.uint8)
    left = np.asarray(cv2.normalize(left, None, 0, 255, cv2.NORM_MINMAX), np.uint8)
    move = np.array([[1.0, 0.0, -6.0], [0.0, 1.0, shift_px]])
    right = np.asarray(cv2.warpAffine(left, move, (320, 200)), np.uint8)
    error, count = vertical_error(left, right)
    assert count > 100
    assert error == pytest.approx(shift_px, abs=0.05)


def test_row_errors_of_a_board_come_from_its_corners() -> None:
    # The board's squares look alike, so its features are matched across them.
    world = World(load_scenario("calibration"), 0)
    frame = SimulatedSource(world).read()
    assert frame is not None
    text = calibration_text(world.true_calibration)
    preview = preview_calibration(frame, text, lambda: None, Board())
    assert preview.matches == 54
    assert preview.vertical_error_px is not None
    assert 0 < preview.vertical_error_px < 0.15
    # No such board is in view, so only features remain.
    assert preview_calibration(frame, text, lambda: None, Board(rows=5)).matches != 54


def test_the_left_view_hatches_unobservable_areas() -> None:
    seen = observed()
    rows = ("." * 20,) * 6 + ("." * 4 + "pp" + "." * 14,) + ("." * 20,) * 6
    unseen = Unseen(2 / 260, {"plain": 2 / 260}, 16, rows, hides_person=False)
    blind = replace(seen, observation=replace(seen.observation, unseen=unseen))
    changed = np.abs(picture("left", blind) - picture("left", seen)).max(axis=2) > 25
    v, u = np.nonzero(changed)
    # Two cells of 16 px, each with a stroke blurred by JPEG.
    assert len(v) > 16
    assert u.min() >= 4 * 16 - 8
    assert u.max() < 6 * 16 + 8
    assert v.min() >= 6 * 16 - 8
    assert v.max() < 7 * 16 + 8
    assert (blind.trace["left"] == seen.trace["left"]).all()
