"""Points of the newest pair for estimating the floor below the camera."""

from __future__ import annotations

import numpy as np

from app.contract.answers import FloorPoints
from app.engine.errors import NotNow
from app.engine.observed import Observed
from observer.camera import as_gray
from observer.rig.ground_estimate import MOST_POINTS
from observer.rig.ground_views import ground_points
from observer.vision.stereo import disparity_map


def look_at_floor(observed: Observed | None) -> FloorPoints:
    """Return the newest pair's points, ``(N, 3)`` metres in the camera frame, and its frame.

    The points are float64.

    Raises:
        NotNow: there is no pair, or only one image.
    """
    right = None if observed is None else observed.trace.get("right")
    if observed is None or right is None:
        raise NotNow("there is no stereo pair to find the floor in; open a stereo source")
    left = as_gray(observed.trace["left"])
    parameters = observed.parameters.stereo
    disparity = disparity_map(left, as_gray(right), parameters)
    points = ground_points(left, disparity, observed.camera)
    # The estimator uses no more of a view; further points would only be transferred.
    if len(points) > MOST_POINTS:
        rng = np.random.default_rng(observed.frame.index)
        points = points[rng.permutation(len(points))[:MOST_POINTS]]
    return FloorPoints(observed.frame.index, points)
