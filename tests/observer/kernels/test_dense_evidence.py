"""The kernels that compare a frame's cells with another frame, against numpy's formulas."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Pose
from observer.kernels.free_space import UNKNOWN, evidence_against
from observer.kernels.grey_change import differs, seen_again
from observer.methods.rigid.dense.free_space import DepthFrame, slack_px
from observer.methods.rigid.dense.grid import Grid
from observer.methods.rigid.dense.reprojection import reprojection

from .oracles import free_space, grey_change

GRIDS = [
    Grid(StereoCamera(128, 80, 90.0, 91.0, 63.2, 39.8, 0.12), 2, 64, 40, 2),
    Grid(StereoCamera(150, 120, 70.0, 70.0, 76.0, 58.0, 0.3), 3, 50, 40, 1),
]
# None, little, and so much that all or part lies behind the other camera or outside its image.
MOTIONS = [
    Pose.identity(),
    Pose.from_rotvec([0.01, -0.03, 0.02], [0.05, -0.02, 0.2]),
    Pose.from_rotvec([0.1, 0.4, -0.3], [-0.6, 0.3, -1.5]),
    Pose.from_rotvec([0.0, np.pi, 0.0], np.zeros(3)),
]
each_case = pytest.mark.parametrize(
    ("seed", "grid", "motion"),
    [(seed, grid, motion) for seed in range(3) for grid in GRIDS for motion in MOTIONS],
)


def depths(grid: Grid, rng: np.random.Generator) -> NDArray[np.float32]:
    """Disparities, px: patches with noise, some cells unknown."""
    patches = rng.choice([np.nan, 2.0, 6.0, 6.3, 15.0, 40.0], (5, 8))
    rough = cv2.resize(patches, (grid.width, grid.height), interpolation=cv2.INTER_NEAREST)
    return (rough + rng.normal(0, 0.3, grid.shape)).clip(0).astype(np.float32)


@each_case
def test_evidence_matches_numpy(seed: int, grid: Grid, motion: Pose) -> None:
    rng = np.random.default_rng(seed)
    disparity = depths(grid, rng)
    other = DepthFrame(0.0, depths(grid, rng), Pose.identity())
    # Unknown cells among those asked for stay unknown.
    asked = np.flatnonzero(rng.random(grid.shape) < 0.8)
    wanted = free_space.against(grid, motion, disparity, other, asked)
    found, left = evidence_against(
        asked,
        disparity.ravel(),
        *reprojection(grid, motion),
        other.disparity.ravel(),
        other.nearest.ravel(),
        other.farthest.ravel(),
        *slack_px(grid),
    )
    np.testing.assert_array_equal(found, wanted)
    np.testing.assert_array_equal(left, asked[wanted == UNKNOWN])


@each_case
def test_cells_found_in_another_frame_match_numpy(seed: int, grid: Grid, motion: Pose) -> None:
    rng = np.random.default_rng(seed)
    disparity = depths(grid, rng)
    other = DepthFrame(0.0, depths(grid, rng), Pose.identity())
    asked = np.flatnonzero(rng.random(grid.shape) < 0.8)
    now, then, alike = seen_again(
        asked,
        disparity.ravel(),
        *reprojection(grid, motion),
        other.nearest.ravel(),
        *slack_px(grid),
    )
    if motion is MOTIONS[-1]:
        assert len(now) == len(then) == len(alike) == 0
        return
    wanted = grey_change.compared(grid, motion, disparity, other, asked)
    np.testing.assert_array_equal(now, asked[wanted.visible])
    np.testing.assert_array_equal(then, wanted.there.at[wanted.visible])
    np.testing.assert_array_equal(alike, wanted.alike[wanted.visible])


@pytest.mark.parametrize("gain", [0.6, 1.0, 1.7])
@pytest.mark.parametrize("limit", [4.0, 30.5])
def test_grey_differences_match_numpy(gain: float, limit: float) -> None:
    """Every grey value against all ranges of darkest and brightest from a few values."""
    levels = np.arange(256, dtype=np.uint8)
    ends = np.array([0, 2, 3, 60, 61, 140, 249, 250, 255], np.uint8)
    grey, one, two = (a.ravel() for a in np.meshgrid(levels, ends, ends))
    darkest, brightest = np.minimum(one, two), np.maximum(one, two)
    at = np.arange(len(grey))
    found = differs(at, at[::-1].copy(), grey, darkest[::-1].copy(), brightest[::-1].copy(),
                    np.float32(gain), np.float32(limit))  # fmt: skip
    wanted = grey_change.changed(grey, darkest, brightest, np.float32(gain), np.float32(limit))
    np.testing.assert_array_equal(found, wanted)
