"""Tracking points through images that were shifted by known fractions of pixels."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.parameters import KltTrackingParameters
from observer.types import Image
from observer.vision.klt_tracking import Sightings, as_bright_as, match_right, track_stereo_points

from ..builders import Texture, as_image, pixel_grid

quick = settings(max_examples=25)
P = KltTrackingParameters()
WIDTH, HEIGHT = 256, 160
DISPARITY = 9.6
WALL, BOARD = Texture(1), Texture(2)
# Inside the image in all four views for every shift used here.
POINTS = pixel_grid(WIDTH, HEIGHT, 9, 32)

Pair = tuple[Image, Image]


def pair(
    du: float = 0.0,
    dv: float = 0.0,
    disparity: float = DISPARITY,
    *,
    noise: float = 0.0,
    seed: int = 0,
    gain: float = 1.0,
    contrast: float = 1.0,
) -> Pair:
    """A wall that moved by (du, dv) pixels in the left image, as both cameras see it."""
    left, right = WALL.moved(du, dv), WALL.moved(du - disparity, dv)
    return (
        as_image(contrast * left, noise, 2 * seed, gain),
        as_image(contrast * right, noise, 2 * seed + 1, gain),
    )


def right_of(px: np.ndarray, disparity: float = DISPARITY) -> np.ndarray:
    return (px - [disparity, 0]).astype(np.float32)


def followed(
    before: Pair,
    after: Pair,
    px: np.ndarray = POINTS,
    *,
    right_px: np.ndarray | None = None,
    expected_px: np.ndarray | None = None,
    disparity: float | np.ndarray = DISPARITY,
    levels: int = 2,
    parameters: KltTrackingParameters = P,
) -> Sightings:
    """Track points of the wall, expected where they were unless stated otherwise."""
    return track_stereo_points(
        before,
        after,
        px,
        right_of(px) if right_px is None else right_px,
        px if expected_px is None else expected_px.astype(np.float32),
        np.broadcast_to(np.float32(disparity), (len(px),)),
        levels,
        parameters,
    )


@quick
@given(st.floats(-6, 6), st.floats(-6, 6), st.floats(-1.5, 1.5))
def test_subpixel_motion_is_tracked_in_both_cameras(du: float, dv: float, nearer: float) -> None:
    seen = followed(pair(), pair(du, dv, DISPARITY + nearer))
    assert seen.found.mean() > 0.9
    off = np.abs(seen.px - POINTS - [du, dv])[seen.found].max(axis=1)
    assert np.mean(off < 0.1) > 0.98
    matched = np.isfinite(seen.right_px[:, 0])
    assert matched[seen.found].mean() > 0.9
    assert not matched[~seen.found].any()
    truth = POINTS + np.array([du - DISPARITY - nearer, dv])
    off = np.abs(seen.right_px - truth)[matched].max(axis=1)
    assert np.mean(off < 0.1) > 0.98


def test_large_motion_is_tracked_only_with_the_right_expectation() -> None:
    du, dv = -41.3, 17.6
    before, after = pair(), pair(du, dv)
    px = POINTS[(POINTS[:, 0] > 80) & (POINTS[:, 1] < 110)]
    guided = followed(before, after, px, expected_px=px + np.array([du + 2, dv - 2]))
    assert guided.found.mean() > 0.95
    assert np.abs(guided.px - px - [du, dv])[guided.found].max() < 0.1
    unguided = followed(before, after, px)
    assert unguided.found.mean() < 0.1


def test_more_levels_track_larger_unexpected_motion() -> None:
    before, after = pair(), pair(15.0, 6.0)
    few, many = (followed(before, after, levels=n).found.mean() for n in (0, 3))
    assert few < 0.3
    assert many > 0.8


def stripes(du: float = 0.0) -> Image:
    u = np.arange(WIDTH) - du
    return as_image(np.tile(60 * np.sin(u / 3) + 30 * np.sin(u / 7), (HEIGHT, 1)))


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (as_image(np.zeros((HEIGHT, WIDTH))), as_image(np.zeros((HEIGHT, WIDTH)))),
        (pair()[0], as_image(np.zeros((HEIGHT, WIDTH)))),
        (stripes(), stripes(1.0)),
        (as_image(0.02 * WALL.moved()), as_image(0.02 * WALL.moved(1.0, 0.0))),
    ],
    ids=["blank", "gone", "along an edge", "hardly anything"],
)
def test_nothing_is_tracked_without_texture_in_every_direction(before: Image, after: Image) -> None:
    seen = followed((before, before), (after, after))
    assert seen.found.mean() < 0.02
    assert not np.isfinite(seen.right_px[~seen.found]).any()


def covered(u0: float, u1: float, board_u: float, board: Texture = BOARD) -> np.ndarray:
    """The wall at rest with a board in front, from u0 to u1, whose texture moved by board_u."""
    u = np.arange(WIDTH)
    return np.where((u >= u0) & (u < u1), board.moved(board_u), WALL.moved())


@pytest.mark.parametrize("check", ["back_check_px", "max_error"])
def test_covered_points_are_lost_rather_than_carried_along(check: str) -> None:
    """A board moves on by 12 px and covers the wall ahead of its edge.

    At low contrast the grey levels differ too little; only the backward check detects it.
    """
    contrast, allowed = (0.25, 10.0) if check == "back_check_px" else (1.0, 100.0)
    before, after = covered(40, 120, 0), covered(52, 132, 12.0)
    u = np.arange(122, 131, 1.0)
    px = np.stack(np.meshgrid(u, np.arange(20, 140, 2.0)), axis=-1).reshape(-1, 2)
    images = (as_image(contrast * before),) * 2, (as_image(contrast * after),) * 2
    hidden, trusting = (
        followed(*images, px.astype(np.float32), disparity=np.nan, parameters=p)
        for p in (P, P.model_copy(update={check: allowed}))
    )
    assert hidden.found.mean() < (0.5 if check == "back_check_px" else 0.1)
    assert trusting.found.mean() > 2 * hidden.found.mean()


def test_wrong_match_does_not_close_the_loop() -> None:
    px = POINTS
    before, after = pair(), pair(2.3, -1.2)
    wrong = right_of(px)
    wrong[::2, 0] += 2.5
    seen = followed(before, after, px, right_px=wrong)
    assert seen.found.mean() > 0.95
    assert np.isfinite(seen.right_px[1::2, 0]).mean() > 0.9
    assert np.isfinite(seen.right_px[::2, 0]).mean() < 0.05
    # Without a match at t there is no loop to close; the match at t+dt counts alone.
    wrong[::2] = np.nan
    seen = followed(before, after, px, right_px=wrong)
    assert np.isfinite(seen.right_px[::2, 0]).mean() > 0.9


def test_motion_in_the_right_image_only_does_not_change_the_depth() -> None:
    """Something passes in front of the wall in the right image only: a finger at the lens."""
    before, after = covered(60, 100, 0), covered(78, 118, 18.0)
    left = as_image(WALL.moved(DISPARITY))
    seen = followed((left, as_image(before)), (left, as_image(after)))
    assert seen.found.mean() > 0.95
    match = seen.right_px[:, 0]
    known = np.isfinite(match)
    there = match - right_of(POINTS)[:, 0]
    u = right_of(POINTS)[:, 0]
    passed = (u > 60 + 7) & (u < 118 - 7)
    assert known[passed].mean() < 0.15
    assert known[(u < 60 - 10) | (u > 118 + 10)].mean() > 0.95
    # A few matches are pulled aside at its edges.
    assert np.mean(np.abs(there[known]) < 0.3) > 0.95


@pytest.mark.parametrize(("rows", "kept"), [(0.0, True), (2.0, True), (5.0, False)])
def test_match_must_lie_on_its_row(rows: float, kept: bool) -> None:
    left, right = as_image(WALL.moved()), as_image(WALL.moved(-DISPARITY, rows))
    expected = np.full(len(POINTS), DISPARITY + 0.7, np.float32)
    end, _ = match_right((left, right), POINTS, expected, P)
    known = np.isfinite(end[:, 0])
    assert known.mean() > 0.95 if kept else known.mean() < 0.05
    np.testing.assert_allclose((POINTS[:, 0] - end[:, 0])[known], DISPARITY, atol=0.1)


@quick
@given(st.floats(1.0, 60.0), st.floats(-2.5, 2.5))
def test_approximate_disparity_is_refined(disparity: float, off: float) -> None:
    images = as_image(WALL.moved()), as_image(WALL.moved(-disparity))
    px = POINTS[POINTS[:, 0] > 80]
    end, _ = match_right(images, px, np.full(len(px), disparity + off, np.float32), P)
    known = np.isfinite(end[:, 0])
    assert known.mean() > 0.9
    assert np.mean(np.abs(px[:, 0] - end[:, 0] - disparity)[known] < 0.1) > 0.98


def test_unknown_disparity_skips_the_right_image() -> None:
    disparity = np.full(len(POINTS), DISPARITY, np.float32)
    disparity[::3] = np.nan
    seen = followed(pair(), pair(1.5, 0.5), disparity=disparity)
    assert seen.found.mean() > 0.95
    assert not np.isfinite(seen.right_px[::3]).any()
    assert np.isfinite(seen.right_px[1::3]).mean() > 0.9


@pytest.mark.parametrize("gain", [0.7, 1.3])
def test_flicker_is_not_motion_after_brightness_matching(gain: float) -> None:
    before, after = pair(contrast=0.5), pair(2.4, -1.7, gain=gain, contrast=0.5)
    alike = as_bright_as(after[0], before[0]), as_bright_as(after[1], before[1])
    seen = followed(alike, after)
    assert seen.found.mean() > 0.95
    error = np.abs(seen.px - POINTS - [2.4, -1.7])[seen.found]
    assert np.percentile(error, 95) < 0.15
    raw = followed(before, after)
    assert raw.found.mean() < 0.8 * seen.found.mean()


def test_brightness_is_matched_unless_an_image_is_black() -> None:
    dim, bright = pair(contrast=0.3, gain=0.5)[0], pair(contrast=0.3)[0]
    assert as_bright_as(bright, dim).mean() == pytest.approx(bright.mean(), abs=1)
    assert as_bright_as(dim, bright).mean() == pytest.approx(dim.mean(), abs=1)
    dark = np.zeros_like(dim)
    assert as_bright_as(bright, dark) is dark
    assert as_bright_as(dark, bright) is bright


def test_points_leaving_the_image_are_not_found() -> None:
    px = np.array([[3, 80], [200, 80], [252, 80], [128, 3], [128, 155]], np.float32)
    still = followed(pair(), pair(), px, disparity=np.nan)
    gone = followed(pair(), pair(-8.0, 0.0), px, disparity=np.nan, expected_px=px - [8, 0])
    assert still.found[1]
    assert gone.found[1]
    assert not gone.found[0]
    wild = px + np.array([[1e4, 0], [0, 0], [-1e4, 0], [0, 1e4], [0, -1e4]])
    assert followed(pair(), pair(), px, disparity=np.nan, expected_px=wild).found.tolist() == [
        False, True, False, False, False,
    ]  # fmt: skip


def test_tracking_and_matching_accept_no_points() -> None:
    none = np.zeros((0, 2), np.float32)
    seen = followed(pair(), pair(), none)
    assert seen.px.shape == seen.right_px.shape == seen.sigma.shape == (0, 2)
    assert seen.found.shape == (0,)
    end, difference = match_right(pair(), none, np.zeros(0, np.float32), P)
    assert end.shape == (0, 2)
    assert difference.shape == (0,)


def normalised_errors(
    noise: float, contrast: float, parameters: KltTrackingParameters
) -> tuple[np.ndarray, np.ndarray]:
    """Errors of position (N, 2) and disparity (N,) divided by their stated standard deviations."""
    position, disparity = [], []
    for seed in range(4):
        du, dv = 1.37 * seed - 2.2, 0.61 * seed
        seen = followed(
            pair(noise=noise, contrast=contrast, seed=10 + seed),
            pair(du, dv, noise=noise, contrast=contrast, seed=20 + seed),
            parameters=parameters,
        )
        both = seen.found & np.isfinite(seen.right_px[:, 0])
        assert both.mean() > 0.7
        position.append(((seen.px - POINTS - [du, dv]) / seen.sigma[:, :1])[both])
        match = seen.px[:, 0] - seen.right_px[:, 0] - DISPARITY
        disparity.append((match / seen.sigma[:, 1])[both])
    return np.concatenate(position), np.concatenate(disparity)


NOISES = [(2.0, 1.0), (4.0, 1.0), (3.0, 0.4), (6.0, 0.5)]


@pytest.mark.parametrize(("noise", "contrast"), [(3.0, 0.4), (6.0, 0.5)])
def test_bare_sigma_matches_the_errors(noise: float, contrast: float) -> None:
    """Without factor and floor, the stated deviation roughly matches the errors.

    Some noise is needed: below 0.03 px, Lucas-Kanade's interpolation error dominates.
    """
    bare = P.model_copy(update={"noise_factor": 1.0, "noise_floor_px": 0.0})
    for errors in normalised_errors(noise, contrast, bare):
        assert 0.6 < np.sqrt(np.mean(errors**2)) < 1.25


@pytest.mark.parametrize(("noise", "contrast"), NOISES)
def test_default_sigma_is_not_overconfident(noise: float, contrast: float) -> None:
    for errors in normalised_errors(noise, contrast, P):
        assert np.sqrt(np.mean(errors**2)) < 1
        assert np.mean(np.abs(errors) < 3) > 0.995


def test_more_noise_or_less_texture_increases_sigma() -> None:
    def sigma(noise: float, contrast: float) -> np.ndarray:
        seen = followed(
            pair(noise=noise, contrast=contrast, seed=1),
            pair(1.3, 0.4, noise=noise, contrast=contrast, seed=2),
        )
        return np.median(seen.sigma[seen.found], axis=0)

    assert (sigma(1.0, 1.0) < sigma(4.0, 1.0)).all()
    assert (sigma(4.0, 1.0) < sigma(4.0, 0.5)).all()
