"""The fit on exactly known camera pairs, and with faulty views."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from observer.calibration.boards.board import BoardSighting, BoardView
from observer.calibration.fitting.fit import fit_stereo
from observer.calibration.fitting.held_out import vertical_errors
from observer.calibration.fitting.stereo_fit import StereoFit
from observer.calibration.fitting.uncertainty import depth_change, view_angles_deg
from observer.camera import StereoCalibration
from observer.errors import CalibrationError
from observer.intervals import SIGMAS_95

from ..board_views import (
    BOARD,
    HEIGHT,
    WIDTH,
    fisheye_pair,
    projected,
    sighting,
    true_pair,
    views_of,
)

TRUE = true_pair()


def fitted(views: list[BoardView], **options: object) -> StereoFit:
    return fit_stereo(views, BOARD, WIDTH, HEIGHT, **options)  # type: ignore[arg-type]


def rotation_error_deg(found: StereoCalibration, true: StereoCalibration) -> float:
    return float(np.degrees(np.linalg.norm(cv2.Rodrigues(found.R @ true.R.T)[0])))


@pytest.mark.parametrize(("seed", "noise_px"), [(0, 0.1), (1, 0.15), (2, 0.2)])
def test_recovers_the_pair_that_took_the_views(seed: int, noise_px: float) -> None:
    fit = fitted(views_of(TRUE, 20, seed, noise_px))
    found = fit.calibration
    for name in ("K1", "K2"):
        K, true = getattr(found, name), getattr(TRUE, name)
        assert K[0, 0] == pytest.approx(true[0, 0], rel=0.003)
        assert K[1, 1] == pytest.approx(true[1, 1], rel=0.003)
        assert K[:2, 2] == pytest.approx(true[:2, 2], abs=2.5)
    assert found.baseline == pytest.approx(TRUE.baseline, rel=0.005)
    pitch, vergence, roll = view_angles_deg(found) - view_angles_deg(TRUE)
    assert abs(vergence) < 0.02
    assert max(abs(pitch), abs(roll)) < 0.05
    # R alone trades off against the principal points, at this noise by up to 0.2 degrees.
    assert rotation_error_deg(found, TRUE) < 0.25
    fresh = [projected_errors(found, seed) for seed in (101, 102)]
    assert np.percentile(np.concatenate(fresh), 95) < 0.3
    assert fit.pairs == 20
    assert all(view.used and view.reason is None for view in fit.views)
    # The noise of two coordinates, minus what the poses and lenses absorb.
    for rms in (fit.rms_left, fit.rms_right, fit.rms_stereo):
        assert rms == pytest.approx(np.sqrt(2) * noise_px, rel=0.08)


def projected_errors(found: StereoCalibration, seed: int) -> np.ndarray:
    """Vertical errors, px, of noise-free corners that the fit never saw."""
    views = views_of(TRUE, 8, seed, 0.0)
    return np.abs(np.concatenate([vertical_errors(found, v.left.px, v.right.px) for v in views]))


def test_stated_uncertainty_matches_actual_errors() -> None:
    """Over several seeds, errors match the stated intervals to within a factor of ten."""
    shares: dict[str, list[float]] = {"focal": [], "baseline": [], "vergence": [], "depth": []}
    per_disparity = 3 / (TRUE.K1[0, 0] * TRUE.baseline)
    for seed in range(4):
        fit = fitted(views_of(TRUE, 8, 20 + seed))
        found, half = fit.calibration, fit.interval_95
        vergence = view_angles_deg(found)[1] - view_angles_deg(TRUE)[1]
        scale, offset = depth_change(TRUE, found)[0]
        shares["focal"].append((found.K1[0, 0] - TRUE.K1[0, 0]) / half.focal_left_px)
        shares["baseline"].append((found.baseline - TRUE.baseline) / half.baseline_m)
        shares["vergence"].append(vergence / half.vergence_deg)
        sigma = fit.depth_bias.relative_sigma(per_disparity)
        shares["depth"].append((scale - offset * per_disparity) / (SIGMAS_95 * sigma))
    for name, values in shares.items():
        assert 0.1 < np.sqrt(np.mean(np.square(values))) < 1.1, (name, values)


def test_held_out_errors_are_little_more_than_noise() -> None:
    fit = fitted(views_of(TRUE, 12, 4, 0.15))
    held_out = fit.held_out
    assert held_out is not None
    assert (held_out.count, held_out.folds) == (12 * 54, 6)
    # Normal errors of two images, 0.15 px each: median 0.67 and 95 % within 1.96 deviations.
    assert held_out.median_px == pytest.approx(0.675 * np.sqrt(2) * 0.15, rel=0.15)
    assert held_out.p95_px == pytest.approx(1.96 * np.sqrt(2) * 0.15, rel=0.15)
    assert held_out.lasting_px < 0.08
    assert fitted(views_of(TRUE, 5, 4)).held_out is None


def test_fits_k3_only_when_needed() -> None:
    plain = fitted(views_of(TRUE, 10, 5)).calibration
    assert plain.D1.size == 5
    assert plain.D1[4] == plain.D2[4] == 0
    bent = replace(
        TRUE,
        D1=np.array([-0.3, 0.2, 0.0005, -0.0003, -0.35]),
        D2=np.array([-0.3, 0.2, 0.0005, 0.0003, -0.35]),
    )
    assert fitted(views_of(bent, 10, 5, 0.1)).calibration.D1[4] == pytest.approx(-0.35, abs=0.15)


def test_fits_fisheye_lenses() -> None:
    true = fisheye_pair()
    fit = fitted(views_of(true, 12, 6, 0.1), distortion_model="equidistant")
    found = fit.calibration
    assert found.distortion_model == "equidistant"
    assert found.D1.size == found.D2.size == 4
    assert found.K1[0, 0] == pytest.approx(300, rel=0.004)
    assert found.baseline == pytest.approx(true.baseline, rel=0.005)
    assert view_angles_deg(found)[1] == pytest.approx(view_angles_deg(true)[1], abs=0.03)
    assert fit.rms_stereo == pytest.approx(0.1 * np.sqrt(2), rel=0.08)


def test_single_camera_views_improve_that_camera() -> None:
    views = views_of(TRUE, 20, 7)
    alone = [
        replace(v, right=None) if k % 3 == 0 else replace(v, left=None) if k % 3 == 1 else v
        for k, v in enumerate(views)
    ]
    both = fitted([v for v in alone if v.left and v.right])
    more = fitted(alone)
    assert more.pairs == both.pairs == 6
    assert more.interval_95.focal_left_px < 0.8 * both.interval_95.focal_left_px
    assert (more.views[0].right_px, more.views[1].left_px) == (None, None)
    assert more.calibration.baseline == pytest.approx(TRUE.baseline, rel=0.005)


def test_partial_boards_are_enough() -> None:
    rng = np.random.default_rng(8)
    parts = [
        BoardView(v.name, *(sighting(s.px, rng.random(54) < 0.4) for s in (v.left, v.right)))
        for v in views_of(TRUE, 20, 8)
    ]
    fit = fitted(parts)
    assert fit.calibration.K1[0, 0] == pytest.approx(520, rel=0.004)
    assert fit.calibration.baseline == pytest.approx(TRUE.baseline, rel=0.005)
    assert fit.pairs == 20


def test_bad_views_are_refused_by_name_with_their_errors() -> None:
    rng = np.random.default_rng(9)
    views = views_of(TRUE, 18, 9)
    views[2] = replace(views[2], right=sighting(views[2].right.px[::-1].copy()))
    views[5] = replace(views[5], left=sighting(views[5].left.px + rng.normal(0, 3, (54, 2))))
    views[8] = replace(views[8], right=sighting(views[8].right.px + np.array([3.0, 2.0])))
    views[11] = replace(views[11], right=views[12].right)
    views[14] = replace(views[14], left=sighting(views[14].left.px, np.arange(54) < 5))
    fit = fitted(views)
    refused = {view.name: view for view in fit.views if not view.used}
    assert set(refused) == {"3", "6", "9", "12", "15"}
    assert "numbered from opposite ends" in refused["3"].reason
    assert "px in the left image (0.2 px in other views): the board moved" in refused["6"].reason
    assert refused["6"].left_px == pytest.approx(3 * np.sqrt(2), rel=0.2)
    assert refused["6"].right_px is None
    for name in ("9", "12"):
        assert "not show the board in the same pose" in refused[name].reason
        assert max(refused[name].left_px, refused[name].right_px) > 1
    assert "shows 5 corners; at least 8" in refused["15"].reason
    assert fit.calibration.K1[0, 0] == pytest.approx(520, rel=0.003)
    assert fit.calibration.baseline == pytest.approx(TRUE.baseline, rel=0.005)


def test_wrong_corners_are_dropped_without_dropping_the_view() -> None:
    views = views_of(TRUE, 9, 19)
    px = views[4].right.px.copy()
    px[[7, 30]] += [[30.0, 10.0], [0.0, -2.5]]
    views[4] = replace(views[4], right=sighting(px))
    fit = fitted(views)
    assert [view.strays for view in fit.views] == [0, 0, 0, 0, 2, 0, 0, 0, 0]
    assert all(view.used for view in fit.views)
    assert fit.rms_stereo == pytest.approx(0.15 * np.sqrt(2), rel=0.08)


def test_board_bend_is_measured() -> None:
    flat = fitted(views_of(TRUE, 8, 20, 0.1)).bend
    bent = fitted(views_of(TRUE, 8, 20, 0.1, bend_m=0.003)).bend
    assert flat is not None
    assert bent is not None
    assert flat.height_m < 4 * flat.sigma_m < 0.001
    assert bent.height_m == pytest.approx(0.003, abs=0.0006)


def test_good_views_survive_a_third_of_mismatched_pairs() -> None:
    views = views_of(TRUE, 18, 10)
    wrong = {0, 3, 6, 9, 12, 15}
    mixed = [replace(v, right=views[(k + 5) % 18].right) if k in wrong else v
             for k, v in enumerate(views)]  # fmt: skip
    fit = fitted(mixed)
    assert {k for k, view in enumerate(fit.views) if not view.used} == wrong
    assert fit.calibration.baseline == pytest.approx(TRUE.baseline, rel=0.005)


def facing_views(count: int) -> list[BoardView]:
    """The board parallel to the image, nearer and farther."""
    rng = np.random.default_rng(0)
    found = []
    for k in range(count):
        place = np.array([rng.uniform(-0.2, 0.05), rng.uniform(-0.15, 0), rng.uniform(0.6, 1.1)])
        turn = np.asarray(cv2.Rodrigues(rng.uniform(-0.04, 0.04, 3))[0], np.float64)
        pair = projected(TRUE, turn, place)
        noisy = [px + rng.normal(0, 0.15, px.shape) for px in pair]
        found.append(BoardView(str(k), *map(sighting, noisy)))
    return found


def one_pose(count: int, noise_px: float) -> list[BoardView]:
    view = views_of(TRUE, 1, 11, 0.0)[0]
    rng = np.random.default_rng(0)
    return [
        BoardView(
            str(k),
            *(sighting(s.px + rng.normal(0, noise_px, (54, 2))) for s in (view.left, view.right)),
        )
        for k in range(count)
    ]


def unpaired(views: list[BoardView]) -> list[BoardView]:
    return [replace(v, right=views[k - 1].right) for k, v in enumerate(views)]


@pytest.mark.parametrize(
    ("views", "words"),
    [
        ([], ["no views in which the left camera sees the board", "at least 5"]),
        (views_of(TRUE, 4, 12), ["4 views in which the left camera", "at least 5"]),
        (
            [replace(v, right=None) if k else v for k, v in enumerate(views_of(TRUE, 9, 12))],
            ["1 view in which the right camera sees"],
        ),
        (
            [
                replace(v, **{("right", "left")[k % 2]: None})
                for k, v in enumerate(views_of(TRUE, 14, 12))
            ],
            ["no views in which both cameras see the board"],
        ),
        (one_pose(12, 0.1), ["only 1 different pose in 12 views", "move and tilt"]),
        (one_pose(8, 0.0), ["only 1 different pose in 8 views"]),
        (facing_views(9), ["focal length", "tilt it by 20 to 40 degrees"]),
        (unpaired(views_of(TRUE, 8, 13)), ["agree on the position of the right camera"]),
        (
            [BoardView(v.name, v.right, v.left) for v in views_of(TRUE, 6, 14)],
            ["120 mm to the left of the left one", "swap"],
        ),
        (views_of(TRUE, 7, 15, noise_px=4.0), ["the overall reprojection error is"]),
    ],
)  # fmt: skip
def test_uncalibratable_views_are_refused_with_a_one_line_reason(
    views: list[BoardView], words: list[str]
) -> None:
    with pytest.raises(CalibrationError) as error:
        fitted(views)
    for part in words:
        assert part in str(error.value)
    assert "\n" not in str(error.value)


def test_vertically_stacked_pair_is_refused() -> None:
    above = replace(TRUE, T=np.array([0.0, -0.08, 0.0]))
    with pytest.raises(CalibrationError, match="side by side"):
        fitted(views_of(above, 6, 16))


def test_progress_is_reported_often_and_increases() -> None:
    reported: list[tuple[str, float]] = []
    fitted(views_of(TRUE, 8, 17), progress=lambda words, share: reported.append((words, share)))
    shares = [share for _, share in reported]
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    assert len(reported) >= 15
    assert all(words for words, _ in reported)


def test_same_views_give_the_same_calibration() -> None:
    views = views_of(TRUE, 6, 18)
    one, two = fitted(views), fitted(views)
    for name in ("K1", "D1", "K2", "D2", "R", "T"):
        assert np.array_equal(getattr(one.calibration, name), getattr(two.calibration, name))
    assert one.held_out == two.held_out


numbers = st.one_of(
    st.floats(-100, 900),
    st.sampled_from([0.0, np.nan, np.inf, 1e12, -1e12]),
)


@st.composite
def sightings(draw: st.DrawFn) -> BoardSighting | None:
    kind = draw(st.sampled_from(["none", "real", "shuffled", "line", "grid", "few", "wild"]))
    rng = np.random.default_rng(draw(st.integers(0, 50)))
    if kind == "none":
        return None
    real = views_of(TRUE, 1, int(rng.integers(4)))[0].left.px
    if kind == "real":
        return sighting(real)
    if kind == "shuffled":
        return sighting(rng.permutation(real))
    if kind == "line":
        return sighting(np.outer(np.arange(54), [draw(st.floats(0, 11)), 4.0]))
    if kind == "grid":
        return sighting(BOARD.object_points[:, :2] * draw(st.floats(-2000, 2000)))
    if kind == "few":
        return sighting(real, np.arange(54) < draw(st.integers(0, 9)))
    ids = np.array(sorted(draw(st.sets(st.integers(-3, 70), max_size=20))), dtype=np.int32)
    wild = [[draw(numbers), draw(numbers)] for _ in ids]
    return BoardSighting(ids, np.array(wild, dtype=np.float64).reshape(-1, 2))


@settings(max_examples=15, derandomize=True, suppress_health_check=list(HealthCheck))
@given(
    st.lists(st.tuples(sightings(), sightings()), max_size=9),
    st.integers(0, 7),
    st.sampled_from(["radtan", "equidistant"]),
)
def test_arbitrary_views_fit_or_raise_a_calibration_error(
    pairs: list[tuple[BoardSighting | None, BoardSighting | None]], good: int, model: str
) -> None:
    views = [BoardView(str(k), *pair) for k, pair in enumerate(pairs)]
    views += views_of(TRUE, 8, 3)[:good]
    try:
        fit = fitted(views, distortion_model=model)
    except CalibrationError:
        return
    assert len(fit.views) == len(views)
    assert np.isfinite([fit.rms_left, fit.rms_right, fit.rms_stereo]).all()
