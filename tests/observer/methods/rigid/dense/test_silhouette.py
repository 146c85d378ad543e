"""Silhouettes of masks whose every cell is known."""

from __future__ import annotations

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.drawing import silhouette_mask
from observer.methods.rigid.dense.grid import Grid
from observer.methods.rigid.dense.silhouette import silhouette_px

CAMERAS = (
    StereoCamera(640, 400, 500.0, 500.0, 319.5, 199.5, 0.12),
    StereoCamera(1280, 720, 900.0, 900.0, 639.5, 359.5, 0.12),
)


def empty(grid: Grid) -> np.ndarray:
    return np.zeros(grid.shape, np.bool_)


def in_pixels(mask: np.ndarray, grid: Grid) -> np.ndarray:
    """(H, W) the pixels of the cells, by the grid's own mapping from pixels to cells."""
    camera = grid.camera
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rows, columns = grid.at(np.stack([u, v], axis=-1).reshape(-1, 2).astype(np.float32))
    return np.asarray(mask[rows, columns]).reshape(camera.height, camera.width)


@pytest.fixture(params=CAMERAS, ids=["2 px a cell", "4 px a cell"])
def grid(request: pytest.FixtureRequest) -> Grid:
    return Grid.of(request.param)


def test_a_rectangle_gives_its_four_corner_pixels(grid: Grid) -> None:
    mask, r = empty(grid), grid.reduction
    mask[20:60, 30:45] = True
    (polygon,) = silhouette_px(mask, grid)
    corners = {
        (30 * r, 20 * r),
        (45 * r - 1, 20 * r),
        (45 * r - 1, 60 * r - 1),
        (30 * r, 60 * r - 1),
    }
    assert {tuple(corner) for corner in polygon.tolist()} == corners
    assert np.array_equal(silhouette_mask([polygon], (mask.shape[0] * r, mask.shape[1] * r)),
                          mask.repeat(r, 0).repeat(r, 1))  # fmt: skip


def test_each_part_has_a_polygon_and_holes_are_filled(grid: Grid) -> None:
    mask = empty(grid)
    mask[10:40, 10:40] = mask[50:60, 100:104] = True
    mask[20:30, 20:30] = False
    polygons = silhouette_px(mask, grid)
    assert len(polygons) == 2
    filled = mask.copy()
    filled[20:30, 20:30] = True
    camera = grid.camera
    drawn = silhouette_mask(polygons, (camera.height, camera.width))
    assert np.array_equal(drawn, in_pixels(filled, grid))


def test_a_round_body_keeps_its_shape_within_a_cell_with_few_corners(grid: Grid) -> None:
    mask = empty(grid)
    rows, columns = np.indices(mask.shape)
    radius = 40.3
    mask |= np.hypot(columns - 80, rows - 60) <= radius
    polygons = silhouette_px(mask, grid)
    (polygon,) = polygons
    middle = grid.to_px(np.array([80.0, 60.0]))
    away = np.hypot(*(polygon - middle).T) / grid.reduction
    assert np.abs(away - radius).max() < 1.0
    assert len(polygon) < 2 * np.pi * radius / 2
    camera = grid.camera
    drawn, truth = (
        silhouette_mask(polygons, (camera.height, camera.width)),
        in_pixels(mask, grid),
    )
    assert (drawn & truth).sum() / (drawn | truth).sum() > 0.97


def test_a_silhouette_at_the_image_border_ends_there(grid: Grid) -> None:
    mask, r = empty(grid), grid.reduction
    mask[:, -10:] = True
    (polygon,) = silhouette_px(mask, grid)
    h, w = grid.shape
    assert polygon.min(axis=0).tolist() == [(w - 10) * r, 0]
    assert polygon.max(axis=0).tolist() == [w * r - 1, h * r - 1]


def test_an_empty_mask_gives_no_polygon(grid: Grid) -> None:
    assert silhouette_px(empty(grid), grid) == ()
