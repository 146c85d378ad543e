"""Connected groups of points."""

from __future__ import annotations

import numpy as np

from observer.kernels.compiled import FLAGS1, WHOLES2, Flags, Indices, kernel, part


@part
def _root(parent: Indices, i: int) -> int:
    while parent[i] != i:
        # Path halving.
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@kernel(WHOLES2, FLAGS1)
def linked(pairs: Indices, chosen: Flags) -> Indices:
    """Return for each point (N,) the first point connected to it by pairs (P, 2).

    Only chosen points (N,) connect; all others are groups of their own (union-find; Tarjan, 1975).
    """
    parent = np.empty(len(chosen), np.int64)
    for i in range(len(chosen)):
        parent[i] = i
    for p in range(len(pairs)):
        i, j = pairs[p, 0], pairs[p, 1]
        if chosen[i] and chosen[j]:
            first, second = _root(parent, i), _root(parent, j)
            parent[max(first, second)] = min(first, second)
    for i in range(len(chosen)):
        parent[i] = _root(parent, i)
    return parent
