"""Cells and pixels: two names for the same places."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.camera import StereoCamera
from observer.methods.rigid.dense.grid import Grid

from ..solid_worlds import CAMERA, GRID

quick = settings(max_examples=50)
places = st.floats(-1000, 2000)


def camera(width: int, height: int) -> StereoCamera:
    return StereoCamera(width, height, width * 0.8, width * 0.82, width / 2, height / 2, 0.1)


@quick
@given(width=st.integers(200, 2600), u=places, v=places)
def test_cells_and_pixels_are_inverse(width: int, u: float, v: float) -> None:
    grid, px = Grid.of(camera(width, width // 2)), np.array([u, v])
    np.testing.assert_allclose(grid.to_px(grid.to_cells(px)), px, atol=1e-9)
    np.testing.assert_allclose(grid.to_cells(grid.to_px(px)), px, atol=1e-9)


@quick
@given(width=st.integers(200, 2600), column=st.integers(0, 99), row=st.integers(0, 49))
def test_every_pixel_of_a_cell_maps_to_it(width: int, column: int, row: int) -> None:
    grid = Grid.of(camera(width, width // 2))
    r = grid.reduction
    first = np.array([column * r, row * r])
    px = first + np.stack(np.meshgrid(np.arange(r), np.arange(r)), axis=-1).reshape(-1, 2)
    rows, columns = grid.at(px.astype(np.float32))
    assert set(rows) == {row}
    assert set(columns) == {column}
    np.testing.assert_allclose(grid.to_px(np.array([column, row])), px.mean(axis=0))


def test_pixels_outside_map_to_the_nearest_cell() -> None:
    px = np.array([[-50, -9], [CAMERA.width + 30, 10], [5, CAMERA.height + 1]], np.float32)
    rows, columns = GRID.at(px)
    assert rows.tolist() == [0, 5, GRID.height - 1]
    assert columns.tolist() == [0, GRID.width - 1, 2]


@quick
@given(column=st.floats(0, 320), row=st.floats(0, 200), z=st.floats(0.5, 20))
def test_the_ray_of_a_cell_is_that_of_its_middle_pixel(column: float, row: float, z: float) -> None:
    ray = GRID.rays @ [column, row, 1.0]
    px, _ = CAMERA.project(z * ray)
    np.testing.assert_allclose(px, GRID.to_px(np.array([column, row])), atol=1e-9)


@quick
@given(z=st.floats(0.5, 20))
def test_cells_per_metre_match_the_projected_length(z: float) -> None:
    px, disparity = CAMERA.project([[-0.5, 0.0, z], [0.5, 0.0, z]])
    ends = GRID.to_cells(px)[:, 0]
    assert GRID.per_metre(float(disparity[0])) == pytest.approx(ends[1] - ends[0])


@pytest.mark.parametrize(("width", "reduction"), [(320, 2), (640, 2), (1280, 4), (1920, 6)])
def test_images_of_any_size_give_a_similar_number_of_cells(width: int, reduction: int) -> None:
    grid = Grid.of(camera(width, width // 2))
    assert grid.reduction == reduction
    assert grid.shape == (width // 2 // reduction, width // reduction)


@pytest.mark.parametrize(
    ("width", "baseline", "reduction"),
    [(848, 0.05, 2), (848, 0.12, 3), (1280, 0.05, 3), (1280, 0.12, 4), (1920, 0.01, 4)],
)
def test_a_short_baseline_takes_smaller_cells(width: int, baseline: float, reduction: int) -> None:
    """So that people stand out of what is behind them, but within limits."""
    rig = replace(camera(width, width // 2), fx=0.5 * width, fy=0.5 * width, baseline=baseline)
    assert Grid.of(rig).reduction == reduction


def test_a_cell_has_the_mean_brightness_of_its_pixels() -> None:
    image = np.random.default_rng(0).integers(0, 256, (400, 640)).astype(np.uint8)
    mean = image.reshape(200, 2, 320, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(GRID.reduced(image), mean, atol=0.51)


@pytest.mark.parametrize(("width", "height"), [(1242, 375), (848, 480), (2208, 1242)])
def test_cells_lie_where_their_pixels_are_if_the_reduction_does_not_divide_the_size(
    width: int, height: int
) -> None:
    grid = Grid.of(camera(width, height))
    assert (width % grid.reduction, height % grid.reduction) != (0, 0)
    # The last cell's brightness is that of its own pixels, in images that are bright in them only.
    last = np.array([grid.width - 1.0, grid.height - 1.0])
    u, v = np.round(grid.to_px(last) - (grid.reduction - 1) / 2).astype(int)
    image = np.zeros((height, width), np.uint8)
    image[v : v + grid.reduction, u : u + grid.reduction] = 200
    small = grid.reduced(image)
    assert small[-1, -1] == 200
    assert np.count_nonzero(small) == 1


@pytest.mark.parametrize(
    ("width", "focal_px", "baseline_m", "column_px"),
    [
        # Two cells of 2 px span less than a person's disparity at 6.6 m.
        (424, 224.0, 0.05, 1),
        (512, 385.0, 0.05, 1),
        (512, 385.0, 0.12, 2),
        (640, 385.0, 0.05, 1),
        (640, 450.0, 0.06, 2),
        # Twice as many columns would cost too much time.
        (848, 425.0, 0.05, 2),
        (1280, 700.0, 0.05, 3),
        (1280, 700.0, 0.065, 2),
        (1226, 707.0, 0.54, 4),
    ],
)
def test_pixels_are_matched_where_cells_are_too_coarse_for_the_baseline(
    width: int, focal_px: float, baseline_m: float, column_px: int
) -> None:
    grid = Grid.of(StereoCamera(width, 240, focal_px, focal_px, width / 2, 120.0, baseline_m))
    assert grid.column_px == column_px
    grey = np.zeros((240, width), np.uint8)
    columns = grid.width * grid.reduction // column_px
    assert grid.matched(grey).shape == (grid.height, columns)
