"""Neighbourhoods of points: sums over neighbours, and connected groups."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.kernels.neighbourhoods import linked


def summed(pairs: NDArray[np.intp], columns: list[Float64Array]) -> Float64Array:
    """Return the sums (N, sum of C) of columns (N, C) over each point and all its neighbours.

    Args:
        pairs: (P, 2) neighbours, each pair once.
    """
    own = np.concatenate(columns, axis=1)
    # Each pair both ways, ordered by the point whose sum it enters.
    point, other = np.concatenate([pairs, pairs[:, ::-1]]).T
    order = np.argsort(point, kind="stable")
    point, other = point[order], other[order]
    first = np.flatnonzero(np.diff(point, prepend=-1))
    if len(first):
        own[point[first]] += np.add.reduceat(own.take(other, axis=0), first, axis=0)
    return own


def grouped(
    pairs: NDArray[np.intp], chosen: NDArray[np.bool_], min_points: int
) -> NDArray[np.int64]:
    """Return the group number (N,) of connected chosen points (N,), largest group first.

    Numbers count from 0; -1 for all other points and for groups of fewer than ``min_points``.
    """
    group = np.full(len(chosen), -1)
    members = np.flatnonzero(chosen)
    if len(members) < min_points:
        return group
    first = linked(pairs, chosen)[members]
    sizes = np.bincount(first, minlength=len(chosen))
    order = np.argsort(-sizes, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    group[members] = np.where(sizes[first] >= min_points, rank[first], -1)
    return group


def false_alarms_per_test(
    false_alarms_per_frame: float, ready: NDArray[np.bool_], neighbours: NDArray[Any]
) -> float:
    """Return the rate allowed per test; tests of points pooled with neighbours are not independent.

    Args:
        ready: (N,) which points are tested. neighbours: (N,) with how many, themselves included.
    """
    count = int(np.count_nonzero(ready))
    each = max(1.0, float(neighbours[ready].mean())) if count else 1.0
    return false_alarms_per_frame / max(1.0, count / each)
