"""Where new points are followed: found by the detector in force, one in each empty square."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.parameters import Parameters
from observer.types import Image
from observer.vision.features import strongest_first
from observer.vision.keypoint_grid import first_in_empty, new_points

# Strong points crowd, so more than one a square must be found for most squares to get one.
_CANDIDATES_PER_SQUARE = 8


def chosen_points(
    image: Image,
    taken: NDArray[np.intp],
    marked: NDArray[np.bool_],
    parameters: Parameters,
    turn: int | None = None,
) -> NDArray[np.float32]:
    """New points (N, 2) px: the strongest of every square in which no point is followed.

    The minimum eigenvalue is what Lucas-Kanade goes by, and is computed for the squares at once;
    the other detectors look at the whole image.

    Args:
        image: (H, W) grey. taken, marked, turn: as of ``selection.new_points``.

    Raises:
        InputError: ``surf`` is asked for and its extra is not installed.
    """
    p = parameters
    if p.features.detector == "shi_tomasi":
        return new_points(image, taken, marked, p.following, turn)
    px = strongest_first(image, p.features, marked.size * _CANDIDATES_PER_SQUARE)
    height, width = image.shape
    return px[first_in_empty(px, (width, height), taken, marked, p.following, turn)]
