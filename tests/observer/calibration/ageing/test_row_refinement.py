"""Row refinement: constructed rotations are found, and when nothing may be changed."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from observer.calibration.ageing.row_refinement import (
    RefinementRefusal,
    RowRefinement,
    matched_points,
    refine_from_scene,
)
from observer.calibration.ageing.vergence import VergenceCheck
from observer.camera import StereoCalibration
from observer.types import Image
from observer.vision.rectification import Rectification

WIDTH, HEIGHT, FOCAL = 640, 360, 500.0
TRUE = StereoCalibration.rectified(WIDTH, HEIGHT, FOCAL, FOCAL, 319.5, 179.5, 0.12)


def pair_seen_by(calibration: StereoCalibration, seed: int = 0) -> tuple[Image, Image]:
    """A textured wall 4 m away, seen by an exact left and a rotated right camera."""
    rng = np.random.default_rng(seed)
    wall = np.zeros((HEIGHT, WIDTH))
    for scale in (2, 4, 8, 16, 32):  # structure on every level of a pyramid
        wall += scale * cv2.GaussianBlur(rng.normal(0, 1, wall.shape), None, scale)
    left = cv2.normalize(wall, None, 0, 255, cv2.NORM_MINMAX)
    # The plane-induced homography of the wall z = 4: K (R + T n^T / 4) K^-1.
    H = (
        calibration.K2
        @ (calibration.R + np.outer(calibration.T, [0, 0, 1]) / 4)
        @ np.linalg.inv(calibration.K1)
    )
    right = cv2.warpPerspective(left, H, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC)
    return left.astype(np.uint8), np.clip(right, 0, 255).astype(np.uint8)


def refined(calibration: StereoCalibration, pairs: list[tuple[Image, Image]]) -> RowRefinement:
    found = refine_from_scene(calibration, pairs)
    assert isinstance(found, RowRefinement), found
    return found


def reason(pairs: list[tuple[Image, Image]]) -> str:
    found = refine_from_scene(TRUE, pairs)
    assert isinstance(found, RefinementRefusal), found
    return found.reason


def turned(pitch_deg: float, yaw_deg: float, roll_deg: float) -> StereoCalibration:
    turn = Rotation.from_euler("xyz", [pitch_deg, yaw_deg, roll_deg], degrees=True).as_matrix()
    return replace(TRUE, R=turn @ TRUE.R, T=turn @ TRUE.T)


@pytest.mark.parametrize(("pitch", "roll"), [(0.1, 0.0), (0.0, -0.15), (-0.12, 0.08)])
def test_finds_the_actual_rotation(pitch: float, roll: float) -> None:
    real = turned(pitch, 0, roll)
    refinement = refined(TRUE, [pair_seen_by(real, seed) for seed in (0, 1)])
    # Bilinear interpolation in rendering and tracking shifts corners by up to 0.05 px.
    left = Rotation.from_matrix(refinement.calibration.R @ real.R.T).magnitude()
    assert left < np.deg2rad(0.02)
    assert pytest.approx(real.T, abs=5e-5) == refinement.calibration.T
    assert refinement.before_px > 0.3
    assert refinement.after_px < 0.05
    assert refinement.matches > 300
    # The correction turns the right camera back.
    turn = np.rad2deg([refinement.pitch_rad, refinement.roll_rad])
    assert turn == pytest.approx([-pitch, -roll], abs=0.02)


def test_leaves_vergence_and_lenses_unchanged() -> None:
    calibration = refined(TRUE, [pair_seen_by(turned(0.1, 0.1, 0))]).calibration
    vergence = Rotation.from_matrix(calibration.R).as_euler("xyz", degrees=True)[1]
    assert vergence == pytest.approx(0, abs=1e-3)
    assert calibration.baseline == pytest.approx(TRUE.baseline)
    assert np.array_equal(calibration.K1, TRUE.K1)
    assert np.array_equal(calibration.K2, TRUE.K2)


def test_reports_uncertainty_and_improvement() -> None:
    pairs = [pair_seen_by(turned(0.1, 0, 0.1), seed) for seed in (0, 1)]
    refinement = refined(TRUE, pairs)
    for value, std in (
        (refinement.pitch_rad, refinement.pitch_std_rad),
        (refinement.roll_rad, refinement.roll_std_rad),
    ):
        assert 0 < std < np.deg2rad(0.01)
        assert abs(value + np.deg2rad(0.1)) < 3 * std
    assert refinement.before_p95_px > refinement.before_px > refinement.after_px
    assert refinement.before_p95_px > 2 * refinement.after_p95_px
    assert refinement.pairs == 2
    assert refinement.coverage > 0.7


def test_refusal_asks_for_texture() -> None:
    blank = np.full((HEIGHT, WIDTH), 128, np.uint8)
    assert "1 pair of images gave 0 matches" in reason([(blank, blank)])
    assert "0 pairs of images" in reason([])
    unrelated = pair_seen_by(TRUE, 0)[0], pair_seen_by(TRUE, 1)[1]
    assert "200 are needed" in reason([unrelated])


def test_refusal_asks_for_texture_on_both_sides() -> None:
    left, right = pair_seen_by(turned(0.1, 0, 0))
    for image in (left, right):
        image[:, : int(0.7 * WIDTH)] = 128
    refusal = reason([(left, right)] * 3)
    assert "to tell roll from pitch" in refusal
    assert "texture on the left and on the right" in refusal


def test_refuses_more_than_a_drift_and_asks_to_recalibrate() -> None:
    assert "recalibrate" in reason([pair_seen_by(turned(0.5, 0, 0))])


def test_refuses_when_no_refinement_is_needed() -> None:
    assert "needs no refinement" in reason([pair_seen_by(TRUE, seed) for seed in (0, 1)])


def test_input_calibration_is_unchanged_and_result_needs_no_further_change() -> None:
    pairs = [pair_seen_by(turned(0.15, 0, 0.1), seed) for seed in (0, 1)]
    found = refined(TRUE, pairs)
    assert np.array_equal(TRUE.R, np.eye(3))
    assert np.array_equal(TRUE.T, [-0.12, 0, 0])
    again = refine_from_scene(found.calibration, pairs)
    if isinstance(again, RowRefinement):
        assert max(abs(again.pitch_rad), abs(again.roll_rad)) < np.deg2rad(0.01)


def test_matched_points_agree_with_the_wall_distance() -> None:
    left, right = matched_points(*pair_seen_by(TRUE))
    assert len(left) > 300
    assert np.median(left[:, 0] - right[:, 0]) == pytest.approx(FOCAL * 0.12 / 4, abs=0.05)
    assert np.median(np.abs(left[:, 1] - right[:, 1])) < 0.03


def through_fisheye(image: Image, K: np.ndarray, D: np.ndarray) -> Image:
    """Return a pinhole image of ``TRUE``'s focal length as seen through an equidistant lens."""
    u, v = np.meshgrid(np.arange(WIDTH, dtype=np.float64), np.arange(HEIGHT, dtype=np.float64))
    px = np.stack([u, v], axis=-1).reshape(1, -1, 2)
    at = cv2.fisheye.undistortPoints(px, K, D, P=TRUE.K1).reshape(HEIGHT, WIDTH, 2)
    x, y = at[..., 0].astype(np.float32), at[..., 1].astype(np.float32)
    return np.asarray(cv2.remap(image, x, y, cv2.INTER_CUBIC), np.uint8)


def test_fisheye_lenses_are_refined() -> None:
    K = np.array([[580.0, 0, 319.5], [0, 580.0, 179.5], [0, 0, 1]])
    D = np.array([0.02, -0.005, 0.001, 0.0])
    lens = replace(TRUE, K1=K, K2=K, D1=D, D2=D, distortion_model="equidistant")
    real = turned(0.1, 0, -0.1)
    pairs = []
    for seed in (0, 1):
        pair = pair_seen_by(real, seed)
        pairs.append((through_fisheye(pair[0], K, D), through_fisheye(pair[1], K, D)))
    found = refined(lens, pairs)
    assert found.calibration.distortion_model == "equidistant"
    assert np.array_equal(found.calibration.D2, D)
    left = Rotation.from_matrix(found.calibration.R @ real.R.T).as_rotvec(degrees=True)
    assert left == pytest.approx([0, 0, 0], abs=0.02)
    assert found.after_px < 0.1 < found.before_px


@pytest.mark.parametrize("vergence_deg", [-0.1, 0.15])
@pytest.mark.parametrize("pitch_deg", [0.0, 0.1])
def test_drifted_vergence_is_removed_from_the_disparities(
    vergence_deg: float, pitch_deg: float
) -> None:
    # A right camera turned towards the left one sees the scene further right.
    real = turned(pitch_deg, vergence_deg, 0)
    pairs = [pair_seen_by(real, seed) for seed in (0, 1)]
    refinement = refine_from_scene(TRUE, pairs, drifted(vergence_deg))
    assert isinstance(refinement, RowRefinement), refinement
    assert refinement.vergence_rad == np.deg2rad(vergence_deg)
    assert refinement.vergence_std_rad == 1e-4
    assert (refinement.pitch_rad != 0) == (pitch_deg != 0)
    calibrated, wrong = disparity_errors(refinement.calibration, real), disparity_errors(TRUE, real)
    bias = FOCAL * np.deg2rad(vergence_deg)
    # Disparities at the image's centre are too small by the bias before, and correct afterwards.
    assert wrong[0] == pytest.approx(-bias, abs=0.05)
    assert np.abs(calibrated).max() < 0.05
    left = Rotation.from_matrix(refinement.calibration.R @ real.R.T).magnitude()
    assert left < np.deg2rad(0.02)
    assert refinement.calibration.baseline == pytest.approx(TRUE.baseline)


@pytest.mark.parametrize("status", ["consistent", "unobserved"])
def test_undrifted_vergence_is_unchanged(
    status: Literal["consistent", "unobserved"],
) -> None:
    check = replace(drifted(0.05), status=status)
    found = refine_from_scene(TRUE, [pair_seen_by(turned(0.1, 0, 0))], check)
    assert isinstance(found, RowRefinement)
    assert found.vergence_rad is None
    assert Rotation.from_matrix(found.calibration.R).as_rotvec()[1] == pytest.approx(0, abs=1e-6)
    still = refine_from_scene(TRUE, [pair_seen_by(TRUE, seed) for seed in (0, 1)], check)
    assert isinstance(still, RefinementRefusal)


def drifted(vergence_deg: float) -> VergenceCheck:
    return VergenceCheck("drifted", np.deg2rad(vergence_deg), 1e-4, "it drifted")


def disparity_errors(calibration: StereoCalibration, real: StereoCalibration) -> np.ndarray:
    """(N,) px error at known places as the real cameras see them, rectified as calibrated."""
    places = np.array([[0.0, 0, 4], [0.9, 0.3, 3], [-0.6, -0.4, 2.5], [1.5, 0, 6], [0.2, 0.2, 1]])
    left = places @ real.K1.T
    right = (places @ real.R.T + real.T) @ real.K2.T
    left_px, right_px = (rays[:, :2] / rays[:, 2:] for rays in (left, right))
    rectification = Rectification(calibration)
    left_px, right_px = rectification.rectify_points(left_px, right_px)
    camera = rectification.camera
    depth = (places @ rectification.R_rectified_left.T)[:, 2]
    return left_px[:, 0] - right_px[:, 0] - camera.fx * camera.baseline / depth
