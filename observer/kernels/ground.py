"""The ground in dense disparity: a plane that gets nearer downwards, and what stands out of it."""

from __future__ import annotations

import math

import numpy as np

from observer.kernels.compiled import (
    REAL,
    REALS1,
    REALS2,
    SINGLE,
    SINGLES1,
    SINGLES2,
    WHOLE,
    WHOLES1,
    WHOLES2,
    Flags,
    Indices,
    Reals,
    Singles,
    kernel,
    part,
)

# Share of the cells that must lie on the ground if no plane is expected.
_FOUND_SHARE = 0.5
# Cells: fewer are no ground.
LEAST_SAMPLES = 150
_REFITS = 2
# Plausible camera: between these heights above the ground, metres, about level sideways, and
# looking neither straight up nor, unless a mount says so, straight down.
_LEAST_HEIGHT, _MOST_HEIGHT = 0.03, 4.0
_MAX_ROLL, _MAX_UP, _LEAST_DOWN = 0.4, 0.5, 0.3


@kernel(SINGLES2, WHOLE, WHOLE, WHOLE, SINGLE)
def nearer_downwards(
    disparity: Singles, top: int, half_rows: int, step: int, rise: np.float32
) -> Indices:
    """Find cells (N,), by index, with nearer depth below than above, as on the ground.

    Args:
        disparity: (h, w) px, NaN unknown. top: first row that counts.
        half_rows: rows from a cell to those compared above and below. step: from cell to cell.
        rise: px, by which the disparity below must at least be larger.
    """
    h, w = disparity.shape
    out = np.empty(((h - top) // step + 1) * (w // step + 1), np.int64)
    count = 0
    for row in range(top + half_rows, h - half_rows, step):
        above, below = disparity[row - half_rows], disparity[row + half_rows]
        for column in range(0, w, step):
            out[count] = row * w + column
            count += below[column] - above[column] > rise
    return out[:count]


@part
def _through(u: Reals, v: Reals, seen: Reals, chosen: Indices, plane: Reals) -> bool:
    """Write the plane (3,) through three cells by Cramer's rule; return False if collinear."""
    i, j, k = chosen[0], chosen[1], chosen[2]
    u1, v1, d1 = u[j] - u[i], v[j] - v[i], seen[j] - seen[i]
    u2, v2, d2 = u[k] - u[i], v[k] - v[i], seen[k] - seen[i]
    det = u1 * v2 - u2 * v1
    if not abs(det) > 1.0:
        return False
    plane[0] = (d1 * v2 - d2 * v1) / det
    plane[1] = (u1 * d2 - u2 * d1) / det
    plane[2] = seen[i] - plane[0] * u[i] - plane[1] * v[i]
    return True


@part
def _plausible(plane: Reals, rays: Reals, focal: float, normal: Reals) -> bool:
    """Write a plane's normal (3,) over camera height, 1/m; return whether it may be the ground."""
    normal[0] = plane[0] / rays[0, 0] / focal
    normal[1] = plane[1] / rays[1, 1] / focal
    normal[2] = plane[2] / focal - rays[0, 2] * normal[0] - rays[1, 2] * normal[1]
    square = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]
    length = max(math.sqrt(square), 1e-9)
    x, y, z = normal[0] / length, normal[1] / length, normal[2] / length
    level = abs(x) < _MAX_ROLL and y > _LEAST_DOWN and z > -_MAX_UP
    return level and _LEAST_HEIGHT < 1 / length < _MOST_HEIGHT


@part
def _refit(u: Reals, v: Reals, seen: Reals, tolerance: Reals, plane: Reals) -> bool:
    """Refit a plane by least squares to the cells on it; return False if there are too few."""
    count = 0
    # Two passes: the mean first, then equations about it, so that they are well conditioned.
    u0 = v0 = d0 = total = 0.0
    uu = uv = vv = ud = vd = 0.0
    for turn in range(2):
        for i in range(len(seen)):
            if not abs(seen[i] - (plane[0] * u[i] + plane[1] * v[i] + plane[2])) < tolerance[i]:
                continue
            w = 1.0 / (tolerance[i] * tolerance[i])
            x, y, z = u[i] - u0, v[i] - v0, seen[i] - d0
            if turn == 0:
                count += 1
                total += w
                ud, vd, vv = ud + w * x, vd + w * y, vv + w * z
            else:
                uu, uv, vv = uu + w * x * x, uv + w * x * y, vv + w * y * y
                ud, vd = ud + w * x * z, vd + w * y * z
        if count < LEAST_SAMPLES:
            return False
        if turn == 0:
            u0, v0, d0 = ud / total, vd / total, vv / total
            ud = vd = vv = 0.0
    det = uu * vv - uv * uv
    if not det > 0.0:
        return False
    plane[0] = (ud * vv - vd * uv) / det
    plane[1] = (vd * uu - ud * uv) / det
    plane[2] = d0 - plane[0] * u0 - plane[1] * v0
    return True


@kernel(WHOLES1, REALS1, WHOLE, REAL, REAL, WHOLES2, REALS1, REALS2, REAL)
def fit_ground(
    at: Indices,
    seen: Reals,
    width: int,
    slack: float,
    slack_share: float,
    triples: Indices,
    expected: Reals,
    rays: Reals,
    focal: float,
) -> Reals:
    """Find the plane of the ground through some of N cells.

    Args:
        at: (N,) indices of the cells, and width: of their rows. seen: (N,) px, disparities.
        slack: px, and slack_share: of the disparity, up to which a cell may be off the plane.
        triples: (T, 3) of the N cells that define the candidate planes (RANSAC).
        expected: (3,) a, b, c of the plane's disparity ``a column + b row + c``; used if there are
            no triples.
        rays: (3, 3) from (column, row, 1) to the ray (x, y, 1). focal: f B, px m.

    Returns:
        The downward normal (3,), camera frame, divided by the camera's height, 1/m; NaN if none.
    """
    count = len(at)
    u, v, tolerance = np.empty(count), np.empty(count), np.empty(count)
    for i in range(count):
        u[i], v[i], tolerance[i] = at[i] % width, at[i] // width, slack + slack_share * seen[i]
    normal, plane, best = np.empty(3), np.empty(3), expected.copy()
    found, most = len(triples) == 0, -count - 1
    for n in range(len(triples)):
        if not _through(u, v, seen, triples[n], plane):
            continue
        if not _plausible(plane, rays, focal, normal):
            continue
        # The best plane has the most cells on it and the fewest below it.
        on, below = 0, 0
        for i in range(count):
            above = seen[i] - (plane[0] * u[i] + plane[1] * v[i] + plane[2])
            on += abs(above) < tolerance[i]
            below += above < -2.0 * tolerance[i]
        if on - below > most:
            most, found = on - below, on >= _FOUND_SHARE * count
            best[0], best[1], best[2] = plane[0], plane[1], plane[2]
    for _ in range(_REFITS):
        found = found and _refit(u, v, seen, tolerance, best)
    if not found or not _plausible(best, rays, focal, normal):
        normal[0] = normal[1] = normal[2] = np.nan
    return normal


@kernel(SINGLES2, SINGLES1, SINGLE, SINGLE)
def stands_out(disparity: Singles, plane: Singles, share: np.float32, least: np.float32) -> Flags:
    """(h, w) which cells are nearer than the ground.

    Args:
        disparity: (h, w) px, NaN unknown. plane: (3,) a, b, c of the ground's disparity
            ``a column + b row + c``.
        share: of a cell's disparity that must exceed the ground's by ``least`` px.
    """
    h, w = disparity.shape
    out = np.empty((h, w), np.bool_)
    a, nothing = plane[0], np.float32(0)
    across = np.empty(w, np.float32)
    for c in range(w):
        across[c] = a * np.float32(c)
    for r in range(h):
        row = plane[1] * np.float32(r) + plane[2]
        d, target = disparity[r], out[r]
        for c in range(w):
            ground = across[c] + row
            above = d[c] * share - (ground if ground > nothing else nothing)
            target[c] = above > least
    return out
