"""Level planes below a stereo camera, found in disparity, where the noise is uniform.

A plane at distance h along the unit vector n (camera frame) is seen with the disparity

    d(x, y) = fB / h (n_x x + n_y y + n_z),    x = X/Z, y = Y/Z,

which is linear in the pixel, and the noise of d is the same everywhere. So least squares in
disparity amounts to least squares over the points, each with its noise Z^2 sigma_d / (fB) along
its ray, but is linear (v-disparity: Labayrade, Aubert, Tarel: Real time obstacle detection in
stereovision on non flat road geometry, IV 2002).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.mount import CameraMount
from observer.robust import MAD_TO_SIGMA

Mask = NDArray[np.bool_]

_HYPOTHESES = 400
# Points that score each hypothesis; more only cost time.
_SCORED = 4000
# Planes looked at, largest first: floor, table, boxes.
_MOST_CANDIDATES = 5
_REFINEMENTS = 8
# Robust standard deviations: a point further off does not belong to the plane.
_GATE = 3.0
# Limits for a camera on a robot; beyond, a plane is a wall, a ceiling or another room's floor.
_MOST_TILT, _MOST_ROLL, _HEIGHT_M = math.radians(45), math.radians(20), (0.05, 3.0)
# Largest angle between two planes that are both level.
PARALLEL = math.radians(4)


@dataclass(frozen=True, eq=False)
class DisparityPoints:
    """N points of one view.

    Attributes:
        ray: (N, 3) x, y and 1: where each is seen, normalised image coordinates.
        disparity: (N,) pixels, positive.
    """

    ray: Float64Array
    disparity: Float64Array

    def __len__(self) -> int:
        return len(self.disparity)

    def chosen(self, rows: Mask | NDArray[np.intp]) -> DisparityPoints:
        return DisparityPoints(self.ray[rows], self.disparity[rows])


@dataclass(frozen=True, eq=False)
class LevelPlane:
    """A plane below the camera, as pixels of disparity: ``coefficients . (x, y, 1)``.

    Attributes:
        coefficients: (3,) fB n / h. fb: focal length times baseline, pixel metres.
        members: (N,) which points of the view belong to it. sigma: their noise, pixels.
        judged: (N,) which points are seen where the plane would be, so that they can lie above or
            beneath it. sunken: (N,) which of them lie beneath it. Nothing lies beneath the floor.
    """

    coefficients: Float64Array
    fb: float
    members: Mask
    sigma: float
    judged: Mask
    sunken: Mask

    @property
    def support(self) -> int:
        return int(np.count_nonzero(self.members))

    @property
    def beneath(self) -> float:
        """Share of the judged points that lie beneath the plane."""
        return float(self.sunken.sum()) / max(1.0, float(self.judged.sum()))

    def beneath_but_for(self, other: LevelPlane) -> float:
        """Return ``beneath`` without the other plane's members."""
        rest = ~other.members
        return float((self.sunken & rest).sum()) / max(1.0, float((self.judged & rest).sum()))

    def carries(self, other: LevelPlane) -> bool:
        """Return whether the other plane lies level above this one, as a table above its floor."""
        lower = float((self.members & other.sunken).sum())
        a, b = self.coefficients, other.coefficients
        cosine = float(a @ b) / float(np.linalg.norm(a) * np.linalg.norm(b))
        return lower > 0.5 * self.support and cosine > math.cos(PARALLEL)

    @property
    def stand(self) -> Float64Array:
        """(3,) height (m), tilt and roll (rad) of the camera above it."""
        return stand_of(self.coefficients, self.fb)

    @property
    def words(self) -> str:
        height, tilt, _ = self.stand
        return f"{height:.2f} m below the camera (tilted {np.degrees(tilt):.0f} degrees)"


def stand_of(coefficients: Float64Array, fb: float) -> Float64Array:
    """(3,) height (m), tilt and roll (rad) of a camera that sees this plane."""
    length = float(np.linalg.norm(coefficients))
    return np.array([fb / length, *CameraMount.angles_of(coefficients / length)])


def level_planes(
    points: DisparityPoints, fb: float, noise_px: float, seed: int
) -> list[LevelPlane]:
    """The level planes below the camera, largest support first; equal seeds give equal planes.

    Args:
        noise_px: one standard deviation of a disparity. seed: usually the frame's number.
    """
    rng = np.random.default_rng(np.random.SeedSequence([seed, 0xF100]))
    left = np.ones(len(points), np.bool_)
    # A plane needs its share of the points, or it is the top of a box.
    fewest = max(100, len(points) // 50)
    planes: list[LevelPlane] = []
    for _ in range(_MOST_CANDIDATES):
        rows = np.flatnonzero(left)
        if len(rows) < fewest:
            break
        start = _best_hypothesis(points.chosen(rows), fb, noise_px, rng)
        if start is None:
            break
        plane = _refined(points, start, fb, noise_px)
        # Points that an earlier plane took do not count again, even where this one is close to it.
        taken = left & _near(points, plane.coefficients, _GATE * max(plane.sigma, noise_px))
        if np.count_nonzero(taken) < fewest:
            break
        left &= ~taken
        if _possible(stand_of(plane.coefficients, fb)[None])[0]:
            planes.append(plane)
    return sorted(planes, key=lambda plane: -plane.support)


def _best_hypothesis(
    points: DisparityPoints, fb: float, noise_px: float, rng: np.random.Generator
) -> Float64Array | None:
    """Return the plane through three points that most points lie on (RANSAC)."""
    triples = rng.integers(0, len(points), (_HYPOTHESES, 3))
    A, d = points.ray[triples], points.disparity[triples]
    # Three points nearly in a line determine no plane.
    spread = np.abs(np.linalg.det(A))
    usable = spread > 1e-3 * spread.max(initial=0.0)
    if not usable.any():
        return None
    coefficients = np.linalg.solve(A[usable], d[usable][..., None])[..., 0]
    coefficients = coefficients[_possible(_camera_poses(coefficients, fb))]
    if not len(coefficients):
        return None
    few = points.chosen(rng.permutation(len(points))[:_SCORED])
    residual = np.abs(few.ray @ coefficients.T - few.disparity[:, None])
    # Truncated squares prefer the plane in the middle of its points (MSAC, Torr 2000).
    score = np.minimum(residual / (_GATE * noise_px), 1.0) ** 2
    return np.asarray(coefficients[int(score.sum(axis=0).argmin())])


def _refined(
    points: DisparityPoints, coefficients: Float64Array, fb: float, noise_px: float
) -> LevelPlane:
    """Refine by least squares with Tukey weights; each round selects points and noise again."""
    sigma = noise_px
    for _ in range(_REFINEMENTS):
        residual = points.disparity - points.ray @ coefficients
        near = np.abs(residual) < _GATE * sigma
        if np.count_nonzero(near) < 3:
            break
        weight = (1 - (residual[near] / (_GATE * sigma)) ** 2) ** 2
        A = points.ray[near] * np.sqrt(weight)[:, None]
        b = points.disparity[near] * np.sqrt(weight)
        coefficients = np.asarray(np.linalg.lstsq(A, b, rcond=None)[0], np.float64)
        robust = MAD_TO_SIGMA * np.median(np.abs(residual[near]))
        sigma = float(np.clip(robust, 0.3 * noise_px, 1.5 * noise_px))
    members = _near(points, coefficients, _GATE * sigma)
    # A plane is not seen beyond its horizon, and where it is nearer than the stereo search range,
    # the matches are wrong.
    expected = points.ray @ coefficients
    searched = points.disparity.max(initial=0.0) - _GATE * noise_px
    judged = (expected > _GATE * noise_px) & (expected < searched)
    sunken = judged & (points.disparity < expected - 2 * _GATE * noise_px)
    return LevelPlane(np.asarray(coefficients, np.float64), fb, members, sigma, judged, sunken)


def _near(points: DisparityPoints, coefficients: Float64Array, gate_px: float) -> Mask:
    expected = points.ray @ coefficients
    near = (np.abs(points.disparity - expected) < gate_px) & (expected > 0)
    return np.asarray(near, np.bool_)


def _camera_poses(coefficients: Float64Array, fb: float) -> Float64Array:
    """(N, 3) as ``stand_of``, for many planes."""
    length = np.maximum(np.linalg.norm(coefficients, axis=1), 1e-9)
    x, y, z = (coefficients / length[:, None]).T
    return np.stack([fb / length, np.arctan2(z, np.hypot(x, y)), np.arctan2(x, y)], axis=1)


def _possible(poses: Float64Array) -> Mask:
    """(N,) which planes can be the ground, given how the camera stands above them, (N, 3)."""
    height, tilt, roll = poses.T
    low, high = _HEIGHT_M
    level = (np.abs(tilt) <= _MOST_TILT) & (np.abs(roll) <= _MOST_ROLL)
    return np.asarray(level & (height >= low) & (height <= high), np.bool_)
