"""Linear algebra on a few numbers, written out: calls would cost more than the arithmetic."""

from __future__ import annotations

import math

import numpy as np

from observer.kernels.compiled import Flags, Reals, part

# Below this angle, rad, sine and cosine are replaced by the first terms of their series.
_SMALL_ANGLE = 1e-4


@part
def clear(A: Reals, b: Reals) -> None:
    """Set A (N, N) and b (N,) to zero."""
    for i in range(len(b)):
        b[i] = 0.0
        for j in range(len(b)):
            A[i, j] = 0.0


@part
def copy_pose(R: Reals, t: Reals, to_R: Reals, to_t: Reals) -> None:
    """Copy a pose (3, 3), (3,) to another."""
    for i in range(3):
        to_t[i] = t[i]
        for j in range(3):
            to_R[i, j] = R[i, j]


@part
def solved(A: Reals, b: Reals, x: Reals) -> bool:
    """Solve A x = b with A (N, N) symmetric positive, by Cholesky's factor, which replaces A.

    Returns:
        False, with x = 0, if A is not positive definite.
    """
    n = len(b)
    for j in range(n):
        pivot = A[j, j]
        for k in range(j):
            pivot -= A[j, k] * A[j, k]
        if not pivot > 0.0:
            for i in range(n):
                x[i] = 0.0
            return False
        root = math.sqrt(pivot)
        A[j, j] = root
        for i in range(j + 1, n):
            entry = A[i, j]
            for k in range(j):
                entry -= A[i, k] * A[j, k]
            A[i, j] = entry / root
    for i in range(n):
        entry = b[i]
        for k in range(i):
            entry -= A[i, k] * x[k]
        x[i] = entry / A[i, i]
    for i in range(n - 1, -1, -1):
        entry = x[i]
        for k in range(i + 1, n):
            entry -= A[k, i] * x[k]
        x[i] = entry / A[i, i]
    return True


@part
def product(A: Reals, B: Reals, out: Reals) -> None:
    """Write A B of matrices (3, 3)."""
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@part
def turned(step: Reals, R: Reals, t: Reals) -> None:
    """Move a pose R (3, 3), t (3,) by a step (6,): rotation vector, rad, and translation.

    Rodrigues' formula, and one step of Newton's iteration for the polar decomposition, so that a
    chain of products stays a rotation (see ``observer.geometry.orthonormal``).
    """
    x, y, z = step[0], step[1], step[2]
    square = x * x + y * y + z * z
    angle = math.sqrt(square)
    if angle < _SMALL_ANGLE:
        sine, half = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        # 1 - cos as a square, which keeps precision for small angles.
        sine, half = math.sin(angle) / angle, 2.0 * (math.sin(angle / 2.0) / angle) ** 2
    W = np.empty((3, 3))
    W[0, 0] = 1 - half * (y * y + z * z)
    W[1, 1] = 1 - half * (x * x + z * z)
    W[2, 2] = 1 - half * (x * x + y * y)
    W[0, 1], W[1, 0] = half * x * y - sine * z, half * x * y + sine * z
    W[0, 2], W[2, 0] = half * x * z + sine * y, half * x * z - sine * y
    W[1, 2], W[2, 1] = half * y * z - sine * x, half * y * z + sine * x
    WR = np.empty((3, 3))
    product(W, R, WR)
    a, b, c = t[0], t[1], t[2]
    for i in range(3):
        t[i] = W[i, 0] * a + W[i, 1] * b + W[i, 2] * c + step[3 + i]
    for i in range(3):
        for j in range(3):
            skew = 0.0
            for k in range(3):
                gram = WR[0, k] * WR[0, j] + WR[1, k] * WR[1, j] + WR[2, k] * WR[2, j]
                skew += WR[i, k] * gram
            R[i, j] = 1.5 * WR[i, j] - 0.5 * skew


@part
def inverse_symmetric(A: Reals, out: Reals) -> None:
    """Write the inverse of A (3, 3), symmetric, by cofactors; not finite if A is singular."""
    c00 = A[1, 1] * A[2, 2] - A[1, 2] * A[1, 2]
    c01 = A[0, 2] * A[1, 2] - A[0, 1] * A[2, 2]
    c02 = A[0, 1] * A[1, 2] - A[0, 2] * A[1, 1]
    det = A[0, 0] * c00 + A[0, 1] * c01 + A[0, 2] * c02
    scale = 1.0 / det if det != 0.0 else np.nan
    out[0, 0], out[1, 1] = c00 * scale, (A[0, 0] * A[2, 2] - A[0, 2] * A[0, 2]) * scale
    out[2, 2] = (A[0, 0] * A[1, 1] - A[0, 1] * A[0, 1]) * scale
    out[0, 1] = out[1, 0] = c01 * scale
    out[0, 2] = out[2, 0] = c02 * scale
    out[1, 2] = out[2, 1] = (A[0, 1] * A[0, 2] - A[0, 0] * A[1, 2]) * scale


@part
def determinant(A: Reals) -> float:
    """Return the determinant of A (3, 3), symmetric."""
    return float(
        A[0, 0] * (A[1, 1] * A[2, 2] - A[1, 2] * A[1, 2])
        - A[0, 1] * (A[0, 1] * A[2, 2] - A[1, 2] * A[0, 2])
        + A[0, 2] * (A[0, 1] * A[1, 2] - A[1, 1] * A[0, 2])
    )


@part
def squared_length(v: Reals, inverse: Reals) -> float:
    """Return v^T C^-1 v, the squared Mahalanobis length of v (3,), by C^-1 (3, 3)."""
    total = 0.0
    for i in range(3):
        for j in range(3):
            total += v[i] * inverse[i, j] * v[j]
    return total


@part
def gathered(values: Reals, which: Flags, out: Reals) -> int:
    """Write the chosen ones of values (N,) to the start of out (N,); return how many."""
    count = 0
    for i in range(len(values)):
        if which[i]:
            out[count] = values[i]
            count += 1
    return count


@part
def ranked(values: Reals, rank: int) -> float:
    """Return the value at ``rank``, from 0, in the order of values (N,), which are reordered.

    By Hoare's quickselect; no value may be NaN.
    """
    low, high = 0, len(values) - 1
    while low < high:
        pivot = values[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if rank <= j:
            high = j
        elif rank >= i:
            low = i
        else:
            break
    return float(values[rank])


@part
def median(values: Reals) -> float:
    """Return the median of values (N,), at least one and none NaN; their order changes."""
    middle = len(values) // 2
    upper = ranked(values, middle)
    if len(values) % 2 == 1:
        return upper
    below = values[0]
    for i in range(1, middle):
        below = max(below, values[i])
    return float((below + upper) / 2.0)


@part
def inverse(S: Reals, out: Reals) -> float:
    """Write the inverse of S (N, N), symmetric, which is overwritten; return ln |det S|."""
    n, logarithm = len(S), 0.0
    # S = L D L^T, L with a unit diagonal; S's lower triangle then holds L and D.
    for j in range(n):
        for k in range(j):
            S[j, j] -= S[j, k] * S[j, k] * S[k, k]
        logarithm += math.log(abs(S[j, j]))
        for i in range(j + 1, n):
            for k in range(j):
                S[i, j] -= S[i, k] * S[j, k] * S[k, k]
            S[i, j] /= S[j, j]
    for column in range(n):
        for i in range(n):
            out[i, column] = 1.0 if i == column else 0.0
            for k in range(i):
                out[i, column] -= S[i, k] * out[k, column]
        for i in range(n - 1, -1, -1):
            out[i, column] /= S[i, i]
            for k in range(i + 1, n):
                out[i, column] -= S[k, i] * out[k, column]
    return logarithm
