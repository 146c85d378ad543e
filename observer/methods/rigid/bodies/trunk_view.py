"""Motion of the trunk of a body with limbs since the last frame, by all of its grey levels.

Plain clothes have few corners, many of them on the arms. Head and shoulders as a whole have an
outline at least.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array, Pose
from observer.kernels.picture_shift import find_shifted
from observer.methods.rigid.dense.people import SHOULDERS_SHARE
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import Segment, upper_part
from observer.types import Image

_LEAST_CELLS = 40


@dataclass(frozen=True, eq=False)
class TrunkView:
    """Appearance of a trunk in one frame.

    Attributes:
        age_s: of its track, seconds. image: (h, w) grey, a pixel for each cell.
        T_world_camera: the pose. at: (2, N) columns and rows of head and shoulders. disparity: px.
    """

    age_s: float
    image: Image
    T_world_camera: Pose
    at: NDArray[np.intp]
    disparity: float

    @staticmethod
    def of(segment: Segment, scene: DenseScene, age_s: float) -> TrunkView | None:
        """Return the view of a trunk at an age of its track; None where little of it is seen."""
        at = upper_part(segment, SHOULDERS_SHARE)
        if at.shape[1] < _LEAST_CELLS:
            return None
        return TrunkView(age_s, scene.left, scene.T_world_camera, at, segment.best_disparity)

    @cached_property
    def middle(self) -> Float64Array:
        """(2,) column and row."""
        return np.asarray(self.at.mean(axis=1))

    def found_in(
        self,
        image: Image,
        expected: Float64Array,
        standing: Float64Array,
        scale: float,
        reach: int,
    ) -> tuple[Float64Array, Float64Array] | None:
        """(2,) column and row of the middle in a later image (h, w), and their covariance (2, 2).

        By Gauss-Newton on the grey levels (Lucas and Kanade, 1981; Baker and Matthews, 2004), with
        weights that fall where arms and the background move differently. None where most of it has
        left the image.

        Args:
            expected: (2,) where it should be. standing: (2,) where it would be if it stood: if that
                explains the image nearly as well, or lies outside it, the covariance is widened to
                include it.
            scale: by which it should be larger. reach: cells to search to either side on its row.
        """
        found, place, cov = find_shifted(
            self.image, self.at, image, expected, standing, scale, reach
        )
        return (place, cov) if found else None
