"""Covariance of a fit by leaving out one view after the other.

Errors of the corners in one view are correlated: blur, a board that is not flat and a lens that
differs from its model shift many of them alike. The curvature of the sum of squares treats each
corner as an independent observation and so claims two to three times too much accuracy, most of all
where few views tilt the board and only these determine the focal length. The views are independent,
so they are what is left out (the delete-one jackknife of clustered data; Cameron and Miller: A
Practitioner's Guide to Cluster-Robust Inference, 2015). One Gauss-Newton step from the solution
stands for each fit without a view, which makes all of them together cheaper than one fit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

from observer.calibration.fitting.adjustment import Corners, StereoModel, reduced_by_view
from observer.geometry import Float64Array
from observer.intervals import SIGMAS_95

# Added to normal matrices scaled to a unit diagonal: where the other views leave a parameter
# undetermined, it makes the step finite but far too long to be overlooked.
_RIDGE = 1e-12


def view_covariance(model: StereoModel, corners: Sequence[Corners], soft_px: float) -> Float64Array:
    """Return the covariance of the global parameters by the scatter between views.

    It is scaled by Student's t for the number of views, so that ``SIGMAS_95`` standard deviations
    are half of a 95 % interval.

    Args:
        model: that fits the corners best. corners, soft_px: as it was fitted to, see ``adjust``.

    Returns:
        (G, G), as ``Adjusted.covariance``.
    """
    S, s = reduced_by_view(model, corners, soft_px)
    scale = 1 / np.sqrt(np.maximum(np.diag(S.sum(axis=0)), 1e-300))
    S, s = S * np.outer(scale, scale), s * scale
    without = S.sum(axis=0) - S + _RIDGE * np.eye(len(scale))
    # At the solution the gradients of all views cancel; without one view, its own is missing.
    moved = -scale * np.linalg.solve(without, s[:, :, None])[:, :, 0]
    apart = moved - moved.mean(axis=0)
    views = len(moved)
    wider = float(stdtrit(views - 1, 0.975)) / SIGMAS_95
    return np.asarray(wider**2 * (views - 1) / views * apart.T @ apart, dtype=np.float64)
