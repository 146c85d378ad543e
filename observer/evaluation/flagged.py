"""Decides whether a line flags an obstacle that it does not report as moving."""

from __future__ import annotations

import numpy as np

from observer.chi_square import quantile
from observer.evaluation.image_boxes import unseen_share
from observer.evaluation.instances import Instance, axis_distance, instances_of
from observer.evaluation.lines import Line
from observer.geometry import Float64Array, Pose
from observer.truth.contract import TrueBody

UNSEEN_SHARE = 0.5
# Squared Mahalanobis distance of the border of a velocity's 95 % region.
VELOCITY_95_CHI2 = quantile(0.95, df=3)
_STANDING = ("stopped", "in_place")


def is_flagged(line: Line, body: TrueBody, world: Pose, gate_m: float) -> bool:
    """Return whether a line flags that this body may have been missed, or reports its place.

    Args:
        world: ``T_truth_world`` of the line's segment. gate_m: distance from a body within which
            an instance belongs to it.
    """
    if line.status == "lost" or _unseen(line, body):
        return True
    coasting = instances_of(line, world, "coasting")
    standing = [i for i in instances_of(line, world, motions=_STANDING) if _may_move(i, body)]
    return any(axis_distance(body, each) <= gate_m for each in [*coasting, *standing])


def squared_length(error: Float64Array, covariance: Float64Array) -> float:
    """Return the squared Mahalanobis length of an error (3,) under its covariance (3, 3)."""
    return float(error @ np.linalg.pinv(covariance) @ error)


def _unseen(line: Line, body: TrueBody) -> bool:
    """Return whether motion could not be noticed where a body is seen."""
    if line.status == "ok" or line.unseen is None or body.box_px is None:
        return False
    return unseen_share(body.box_px, line.unseen) >= UNSEEN_SHARE


def _may_move(instance: Instance, body: TrueBody) -> bool:
    """Return whether a body's velocity lies within an instance's 95 % region."""
    if instance.velocity_cov is None:
        return False
    return (
        squared_length(instance.velocity - body.velocity, instance.velocity_cov) <= VELOCITY_95_CHI2
    )
