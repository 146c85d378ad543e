"""Finds a few hundred cells of one image in another one, by their grey levels."""

from __future__ import annotations

import math

import numpy as np

from observer.kernels.compiled import (
    BYTES2,
    REAL,
    REALS1,
    WHOLE,
    WHOLES2,
    Flags,
    Indices,
    Reals,
    kernel,
    part,
)
from observer.kernels.compiled import Bytes as Image
from observer.kernels.small import clear, gathered, median, solved
from observer.robust import MAD_TO_SIGMA

# Cells: Gauss-Newton ends when a step is below this; and its most steps.
_LEAST_STEP, _STEPS = 0.01, 10
# Grey levels: least noise assumed; and standard deviations: scale of the robust weights.
_LEAST_NOISE, _FULL_SIGMAS = 1.0, 2.0
# Grey levels: differences are capped at this in the coarse search.
_MOST_DIFFERENCE = 20.0
# Cost factor that a place beside the expected one must undercut.
_CLEARLY_LESS = 0.8
# The Sobel operator sums its step eight times, and its noise over twelve squared weights.
_SOBEL_SCALE = 1 / 8
_GRADIENT_NOISE = 12 * _SOBEL_SCALE**2
_RIDGE = 1e-6
# Subpixel steps to which places are rounded, as in OpenCV's remap.
_FINE_BITS = 5
_FINE = 1 << _FINE_BITS
_UNFINE = 1.0 / _FINE**2


@part
def _level(image: Image, row: int, column: int) -> float:
    """Return the grey level of a pixel, 0 outside of the image."""
    if 0 <= row < image.shape[0] and 0 <= column < image.shape[1]:
        return float(image[row, column])
    return 0.0


@part
def _mirrored(i: int, count: int) -> int:
    """Return the index of a row or column, mirrored at the border if it lies outside."""
    if i < 0:
        return min(-i, count - 1)
    return i if i < count else max(2 * count - 2 - i, 0)


@part
def _describe(image: Image, at: Indices, levels: Reals, J: Reals, steep: Flags) -> None:
    """Write grey levels (N,), their derivatives by column, row and brightness J (N, 3), and steep.

    Gradients are by the Sobel operator. Steep cells (N,) are those that determine the position.
    """
    count, height, width = at.shape[1], image.shape[0], image.shape[1]
    total = 0.0
    for i in range(count):
        column, row = at[0, i], at[1, i]
        levels[i] = float(image[row, column])
        above, below = _mirrored(row - 1, height), _mirrored(row + 1, height)
        before, after = _mirrored(column - 1, width), _mirrored(column + 1, width)
        # Differences of opposite corners along both diagonals.
        falls = float(image[below, after]) - float(image[above, before])
        rises = float(image[above, after]) - float(image[below, before])
        across = falls + rises + 2.0 * (float(image[row, after]) - float(image[row, before]))
        down = falls - rises + 2.0 * (float(image[below, column]) - float(image[above, column]))
        J[i, 0], J[i, 1], J[i, 2] = across * _SOBEL_SCALE, down * _SOBEL_SCALE, 1.0
        total += abs(J[i, 0]) + abs(J[i, 1])
    for i in range(count):
        steep[i] = abs(J[i, 0]) + abs(J[i, 1]) >= total / count


@part
def _compare(
    image: Image, levels: Reals, spread: Reals, u: float, v: float, lighter: Reals, inside: Flags
) -> int:
    """Write by how much the image is lighter (N,), and which cells are inside it; count these.

    Args:
        spread: (2, N) offsets of the cells from their centre, which is at column u and row v.
    """
    count, last_column, last_row = 0, image.shape[1] - 1, image.shape[0] - 1
    for i in range(len(levels)):
        # Bilinear, in single precision, with places rounded to subpixel steps.
        x, y = np.float32(spread[0, i] + u), np.float32(spread[1, i] + v)
        inside[i] = x >= 0 and x <= last_column and y >= 0 and y <= last_row
        count += inside[i]
        fine_x, fine_y = round(float(x) * _FINE), round(float(y) * _FINE)
        column, row = fine_x >> _FINE_BITS, fine_y >> _FINE_BITS
        a, b = float(fine_x & (_FINE - 1)), float(fine_y & (_FINE - 1))
        if 0 <= row < last_row and 0 <= column < last_column:
            upper = (_FINE - a) * image[row, column] + a * image[row, column + 1]
            lower = (_FINE - a) * image[row + 1, column] + a * image[row + 1, column + 1]
        else:
            upper = (_FINE - a) * _level(image, row, column) + a * _level(image, row, column + 1)
            row += 1
            lower = (_FINE - a) * _level(image, row, column) + a * _level(image, row, column + 1)
        now = math.floor(((_FINE - b) * upper + b * lower) * _UNFINE + 0.5)
        lighter[i] = now - levels[i]
    return count


@part
def _median_of(values: Reals, which: Flags, scratch: Reals) -> float:
    """Return the median of some of N values, at least one."""
    return median(scratch[: gathered(values, which, scratch)])


@part
def _cost(
    image: Image, levels: Reals, spread: Reals, u: float, v: float,
    lighter: Reals, inside: Flags, scratch: Reals,
) -> float:  # fmt: skip
    """Return the mean difference at a place, grey levels; infinite if most of it is outside."""
    count = _compare(image, levels, spread, u, v, lighter, inside)
    if 2 * count <= len(levels):
        return np.inf
    light = _median_of(lighter, inside, scratch)
    total = 0.0
    for i in range(len(levels)):
        if inside[i]:
            total += min(abs(lighter[i] - light), _MOST_DIFFERENCE)
    return total / count


@part
def _fit(
    image: Image, levels: Reals, spread: Reals, J: Reals, chosen: Flags, place: Reals,
    lighter: Reals, inside: Flags, scratch: Reals, information: Reals,
) -> tuple[float, float]:  # fmt: skip
    """Refine the place (2,) of the cells' centre by Gauss-Newton.

    Args:
        J: (N, 3) as of ``_describe``. chosen: (N,) the cells from which the noise is estimated.
        information: (3, 3), written: sums of products of gradients and brightness.

    Returns:
        The noise, grey levels, and the sum of all weights; both 0 if most of the cells, or all
        chosen ones, have left the image.
    """
    A, g, step = np.empty((3, 3)), np.empty(3), np.empty(3)
    light = noise = cells = 0.0
    for turn in range(_STEPS + 1):
        count = _compare(image, levels, spread, place[0], place[1], lighter, inside)
        if count == 0 or (turn > 0 and 2 * count <= len(levels)):
            return 0.0, 0.0
        if turn == _STEPS:
            break
        if turn == 0:
            light = _median_of(lighter, inside, scratch)
        count = 0
        for i in range(len(levels)):
            if inside[i] and chosen[i]:
                scratch[count] = abs(lighter[i] - light)
                count += 1
        if count == 0:
            return 0.0, 0.0
        noise = max(_LEAST_NOISE, MAD_TO_SIGMA * median(scratch[:count]))
        clear(information, g)
        cells = 0.0
        for i in range(len(levels)):
            if not inside[i]:
                continue
            residual = lighter[i] - light
            weight = 1.0 / (1.0 + (residual / (_FULL_SIGMAS * noise)) ** 2)
            cells += weight
            for k in range(3):
                g[k] += weight * J[i, k] * residual
                for m in range(3):
                    information[k, m] += weight * J[i, k] * J[i, m]
        for k in range(3):
            information[k, k] += _RIDGE
            for m in range(3):
                A[k, m] = information[k, m]
        solved(A, g, step)
        place[0] -= step[0]
        place[1] -= step[1]
        light += step[2]
        if max(abs(step[0]), abs(step[1])) < _LEAST_STEP:
            break
    return noise, cells


@part
def _covariance(A: Reals, noise: float, cells: float, out: Reals) -> None:
    """Write the covariance (2, 2) cells^2 of a place, with the brightness unknown.

    The gradients' own noise is subtracted, since it carries no information.

    Args:
        A: (3, 3) sums over ``cells`` cells of products of gradients. noise: grey levels, of the
            difference of two images.
    """
    less = _GRADIENT_NOISE * cells * noise * noise / 2.0
    a = A[0, 0] - A[0, 2] * A[0, 2] / A[2, 2] - less
    b = A[1, 0] - A[0, 2] * A[1, 2] / A[2, 2]
    d = A[1, 1] - A[1, 2] * A[1, 2] / A[2, 2] - less
    # From its eigenvalues m + h and m - h, none below the ridge, and their eigenvectors.
    m, h = (a + d) / 2.0, math.sqrt(((a - d) / 2.0) ** 2 + b * b)
    most, least = noise * noise / max(m - h, _RIDGE), noise * noise / max(m + h, _RIDGE)
    c, s = ((a - d) / 2.0 / h, b / h) if h > 0.0 else (1.0, 0.0)
    out[0, 0] = ((1.0 + c) * least + (1.0 - c) * most) / 2.0
    out[1, 1] = ((1.0 - c) * least + (1.0 + c) * most) / 2.0
    out[0, 1] = out[1, 0] = s * (least - most) / 2.0


@kernel(BYTES2, WHOLES2, BYTES2, REALS1, REALS1, REAL, WHOLE)
def find_shifted(
    before: Image, at: Indices, image: Image,
    expected: Reals, standing: Reals, scale: float, reach: int,
) -> tuple[bool, Reals, Reals]:  # fmt: skip
    """Find N cells of an image in another one, see ``TrunkView.found_in``.

    By Gauss-Newton on the grey levels (Lucas and Kanade, 1981; Baker and Matthews, 2004).

    Args:
        before: (h, w) grey. at: (2, N) columns and rows in it. image: (h, w), the other one.
        expected: (2,) predicted column and row of their centre. standing: (2,) the same if they
            were static; the same as expected if they cannot be. scale: predicted factor on their
            size. reach: cells by which they may be off along their row.

    Returns:
        Whether they are found, column and row (2,) of their centre, and its covariance (2, 2).
    """
    n = at.shape[1]
    levels, J, steep, spread = (
        np.empty(n), np.empty((n, 3)), np.empty(n, np.bool_), np.empty((2, n)),
    )  # fmt: skip
    _describe(before, at, levels, J, steep)
    for k in range(2):
        middle = 0.0
        for i in range(n):
            middle += at[k, i]
        middle /= n
        for i in range(n):
            spread[k, i] = (at[k, i] - middle) * scale
    lighter, inside, scratch = np.empty(n), np.empty(n, np.bool_), np.empty(n)
    place, cov, information = np.empty(2), np.empty((2, 2)), np.empty((3, 3))
    # Coarse search: at the expected place, unless the difference is clearly less some whole columns
    # beside it, nearest first. The last round evaluates the place where static cells would be.
    least, stood = np.inf, np.inf
    for k in range(2 * reach + 2):
        stands = k == 2 * reach + 1
        off = -(k + 1) // 2 if k % 2 == 1 else k // 2
        u, v = (standing[0], standing[1]) if stands else (expected[0] + off, expected[1])
        cost = _cost(image, levels, spread, u, v, lighter, inside, scratch)
        clearly = 1.0 if off == 0 else _CLEARLY_LESS
        if stands:
            stood = cost
        elif cost < clearly * least:
            place[0], place[1], least = u, v, cost / clearly
    if least == np.inf:
        return False, place, cov
    # First with the noise of the steep cells, so that edges are not taken for outliers while far
    # off; then with the noise of all cells. The covariance is that of the first round.
    for turn in range(2):
        noise, cells = _fit(
            image, levels, spread, J, steep, place, lighter, inside, scratch, information
        )
        if noise == 0.0:
            return False, place, cov
        if turn == 0:
            _covariance(information, noise, cells, cov)
            for i in range(n):
                steep[i] = True
    cost = _cost(image, levels, spread, place[0], place[1], lighter, inside, scratch)
    if stood == np.inf or cost > _CLEARLY_LESS * stood:
        a, b = place[0] - standing[0], place[1] - standing[1]
        cov[0, 0] += a * a
        cov[1, 1] += b * b
        cov[0, 1] += a * b
        cov[1, 0] += a * b
    return True, place, cov
