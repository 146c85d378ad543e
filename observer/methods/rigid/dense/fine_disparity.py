"""Disparity of a segment by its grey levels, free of pixel locking.

The disparities of cells cluster at whole cells (pixel locking; Shimizu and Okutomi, 2001): a body
that comes nearer seems to stand, and then to leap. The grey levels of its whole trunk, found in
the right image all together, have no such preference.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from observer.kernels.picture_shift import find_shifted
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import TRUNK_SHARE, Segment, upper_part
from observer.robust import median

# Fewer cells do not tell enough. Of about so many more only those of some rows are used, which
# include both sides of the contour.
_LEAST_CELLS, _MOST_CELLS = 40, 1600
# Cells to either side that are searched. Locking shifts a disparity by less than the second number;
# one that is farther off is that of another surface.
_REACH, _MOST_SHIFT = 1, 0.75
# Cells: a standard deviation above this tells less than the cells do.
_MOST_SIGMA = 0.5


def refined(segment: Segment, scene: DenseScene) -> Segment:
    """Return a segment with its disparity by its grey levels, where they tell it."""
    return replace(segment, fine=_fine_disparity(segment, scene))


def _fine_disparity(segment: Segment, scene: DenseScene) -> float | None:
    """Return the disparity, px, of the trunk of a segment; None where its images do not tell."""
    at = upper_part(segment, TRUNK_SHARE)
    count = at.shape[1]
    if count < _LEAST_CELLS:
        return None
    at = np.ascontiguousarray(at[:, at[1] % -(-count // _MOST_CELLS) == 0])
    reduction = scene.grid.reduction
    correction = scene.disparity[segment.mask] - scene.matched[segment.mask]
    correction_px = median(correction[np.isfinite(correction)])
    matched = (segment.disparity - correction_px) / reduction
    column, row = at.mean(axis=1).tolist()
    expected = np.array([column - matched, row])
    found, place, cov = find_shifted(scene.left, at, scene.right, expected, expected, 1.0, _REACH)
    shift = column - float(place[0]) - matched
    if not found or abs(shift) > _MOST_SHIFT or math.sqrt(cov[0, 0]) > _MOST_SIGMA:
        return None
    return float(segment.disparity + shift * reduction)
