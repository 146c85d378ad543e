"""95 % intervals of a fit contain the truth, over seeds, for well and barely determined views.

Corner errors are as in real images: neighbours are correlated, each view has its own blur, the
board is bent by some tenths of a millimetre, and the lens has one term more than is fitted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from observer.calibration.boards.board import BoardView
from observer.calibration.fitting.adjustment import Adjusted, Corners, StereoModel, adjust
from observer.calibration.fitting.fit import fit_stereo
from observer.calibration.fitting.initialization import with_poses
from observer.calibration.fitting.lens import Lens
from observer.calibration.fitting.outlier_views import soft_threshold
from observer.calibration.fitting.sightings import corners_of
from observer.calibration.fitting.stereo_fit import StereoFit
from observer.calibration.fitting.uncertainty import Interval95, error_covariance, interval_95
from observer.calibration.fitting.view_jackknife import view_covariance
from observer.calibration.report import fit_report
from observer.calibration.verdict import judge
from observer.camera import StereoCalibration
from observer.geometry import Float64Array

from ..board_views import BOARD, HEIGHT, WIDTH, sighting, true_pair

SEEDS = 30
TRUE = true_pair()


@dataclass(frozen=True)
class Pictures:
    """How views are taken: tilts up to ``tilt_deg``, board ``widths`` as shares of the image."""

    count: int
    tilt_deg: float
    widths: tuple[float, float]
    bow_m: float = 0.0
    k3: float = 0.0


WELL = Pictures(15, 40, (0.35, 0.85))
BARELY = Pictures(12, 9, (0.5, 0.55))


def taken(pictures: Pictures, seed: int) -> tuple[StereoCalibration, list[BoardView]]:
    """The pair and its views."""
    rng = np.random.default_rng(seed)
    D1, D2 = ([*D[:4], pictures.k3] for D in (TRUE.D1, TRUE.D2))
    true = replace(TRUE, D1=np.array(D1), D2=np.array(D2))
    points = BOARD.object_points
    u = 2 * points[:, :2] / points[-1, :2] - 1
    shape = rng.normal(size=3)
    points[:, 2] = (
        pictures.bow_m * np.stack([*u.T**2, u.prod(axis=1)], 1) @ shape / np.sqrt(shape @ shape)
    )
    views: list[BoardView] = []
    while len(views) < pictures.count:
        turn = [*rng.uniform(-1, 1, 2) * pictures.tilt_deg, rng.uniform(-20, 20)]
        R = Rotation.from_euler("xyz", turn, degrees=True).as_matrix()
        z = true.K1[0, 0] * BOARD.size_m[0] / (rng.uniform(*pictures.widths) * WIDTH)
        middle = np.array([rng.uniform(-0.3, 0.3) * WIDTH, rng.uniform(-0.25, 0.25) * HEIGHT])
        t = z * np.array([*middle / true.K1[0, 0], 1.0]) - R @ BOARD.object_points.mean(axis=0)
        left = points @ R.T + t
        pair = [
            cv2.projectPoints(p, np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
            for p, K, D in (
                (left, true.K1, true.D1), (left @ true.R.T + true.T, true.K2, true.D2)
            )
        ]  # fmt: skip
        if all((px > 3).all() and (px < [WIDTH - 4, HEIGHT - 4]).all() for px in pair):
            blur = 0.15 * np.exp(rng.normal(0, 0.35))
            noisy = (sighting(px + blur * SHARED @ rng.normal(size=px.shape)) for px in pair)
            views.append(BoardView(str(len(views) + 1), *noisy))
    return true, views


def shared_noise() -> Float64Array:
    """(54, 54) factor for noise, of which corners share 60 % over two or three squares."""
    place = BOARD.object_points / BOARD.square_m
    apart = np.linalg.norm(place[:, None] - place, axis=2)
    covariance = 0.6 * np.exp(-((apart / 2.5) ** 2) / 2) + 0.4 * np.eye(len(place))
    return np.linalg.cholesky(covariance)


SHARED = shared_noise()


def solved(true: StereoCalibration, views: list[BoardView]) -> Solved:
    """The last step of a fit, started near the solution, with k3 left out."""
    corners = corners_of(views, BOARD, np.ones(len(views), np.bool_))
    lenses = tuple(
        Lens("radtan", np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *D[:4], 0.0]))
        for K, D in ((true.K1, true.D1), (true.K2, true.D2))
    )
    poses = np.tile(np.eye(3), (len(views), 1, 1)), np.zeros((len(views), 3))
    model = StereoModel((WIDTH, HEIGHT), lenses, np.arange(9) < 8, true.R, true.T, *poses)
    model = with_poses(model, 0, corners[0])
    soft_px = soft_threshold(adjust(model, corners, iterations=5).residuals)
    return Solved(true, adjust(model, corners, soft_px=soft_px), corners, soft_px)


@dataclass(frozen=True, eq=False)
class Solved:
    """A fit, the corners it was fitted to, and the true pair."""

    true: StereoCalibration
    found: Adjusted
    corners: tuple[Corners, Corners]
    soft_px: float

    def holds(self, covariance: Float64Array | None) -> NDArray[np.bool_]:
        """Which intervals contain the truth: both fx, cx and cy of the left one, the baseline."""
        assert covariance is not None
        assert self.found.covariance is not None
        near = 0.5 * np.sqrt(np.diag(self.found.covariance))
        half = interval_95(self.found.model, covariance, near)
        error = errors(self.found.model.calibration, self.true)
        return np.abs(error) <= widths(half)


@cache
def all_solved(pictures: Pictures) -> list[Solved]:
    return [solved(*taken(pictures, seed)) for seed in range(SEEDS)]


def held(pictures: Pictures) -> Float64Array:
    """Share of seeds in which each interval contains the truth."""
    return np.mean(
        [
            each.holds(error_covariance(each.found, each.corners, BOARD, each.soft_px))
            for each in all_solved(pictures)
        ],
        axis=0,
    )


def errors(found: StereoCalibration, true: StereoCalibration) -> Float64Array:
    """Errors of fx of both cameras, cx and cy of the left one, and the baseline."""
    px = [found.K1 - true.K1, found.K2 - true.K2]
    return np.array(
        [px[0][0, 0], px[1][0, 0], px[0][0, 2], px[0][1, 2], found.baseline - true.baseline]
    )


def widths(half: Interval95) -> Float64Array:
    return np.array(
        [half.focal_left_px, half.focal_right_px, *half.centre_left_px, half.baseline_m]
    )


@pytest.mark.parametrize(
    "pictures",
    [
        WELL,
        replace(WELL, bow_m=0.0005, k3=-0.1),
        BARELY,
        replace(BARELY, bow_m=0.0005, k3=-0.1),
    ],
    ids=["well", "well, bent board and lens", "barely", "barely, bent board and lens"],
)
def test_intervals_contain_the_truth(pictures: Pictures) -> None:
    # At 95 %, fewer than 25 of 30 seeds have a probability of 0.003.
    assert held(pictures).min() >= 25 / SEEDS


def test_curvature_alone_is_overconfident() -> None:
    """Shows that the test above is meaningful: these sets of views are the hard ones."""
    share = np.mean([each.holds(each.found.covariance) for each in all_solved(BARELY)], axis=0)
    assert share[[0, 1, 4]].max() < 0.8


def test_value_determined_by_a_single_view_is_uncertain() -> None:
    """One tilted view beside eleven that face the camera determines the focal length alone."""
    _, facing = taken(replace(BARELY, count=11), 3)
    true, tilted = taken(replace(WELL, count=1), 4)
    fit = solved(true, [*facing, *tilted])
    assert fit.found.covariance is not None
    scatter = view_covariance(fit.found.model, fit.corners, fit.soft_px)
    assert scatter[0, 0] > 3**2 * fit.found.covariance[0, 0]


@pytest.fixture(scope="module")
def barely() -> StereoFit:
    return fit_stereo(taken(BARELY, 5)[1], BOARD, WIDTH, HEIGHT)


def test_verdict_suggests_which_pictures_to_add(barely: StereoFit) -> None:
    verdict = judge(barely, 30.0)
    (warning,) = [text for text in verdict.warnings if "focal length" in text]
    c, half = barely.calibration, barely.interval_95
    share = max(half.focal_left_px / c.K1[0, 0], half.focal_right_px / c.K2[0, 0])
    side, focal, width = (
        ("left", c.K1[0, 0], half.focal_left_px)
        if half.focal_left_px / c.K1[0, 0] == share
        else ("right", c.K2[0, 0], half.focal_right_px)
    )
    assert f"that of the {side} camera may be anywhere from {focal - width:.0f} to " in warning
    assert f"{focal + width:.0f} px (95 % interval)" in warning
    assert "tilted by 30 to 45 degrees to each side, up and down, at several dist" in warning
    report = fit_report(barely, verdict)
    assert report["interval_95"]["focal_left_px"] == half.focal_left_px
    assert warning in report["verdict"]["warnings"]


def test_well_determined_focal_length_gives_no_warning() -> None:
    fit = fit_stereo(taken(replace(WELL, count=12), 5)[1], BOARD, WIDTH, HEIGHT)
    assert not [text for text in judge(fit, 30.0).warnings if "focal length" in text]
