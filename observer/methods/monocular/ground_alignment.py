"""The camera's motion in metres from the appearance of the ground, whose texture moves as a plane.

A bare floor has few corners, but its joints and edges have many pixels. Those of one image are
projected onto the known plane and aligned with another image, coarse to fine, for all six degrees
of freedom at once (Baker and Matthews: Lucas-Kanade 20 Years On, IJCV 2004). Objects standing on
the ground do not fit the plane and get little weight.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose, cross_matrix
from observer.methods.monocular.ground import GroundPlane
from observer.methods.monocular.pose import held_above_ground, moved_by
from observer.robust import MAD_TO_SIGMA
from observer.types import Image

_Float32Array = NDArray[np.float32]

# Standard deviation of the smoothing, px, and the least slope of a pixel that counts, grey
# levels/px: at least three times the slope that noise of 2 grey levels leaves after smoothing.
_LEVELS = ((3.0, 0.35), (1.0, 1.2))
# Brightness that changes more slowly than this many times the smoothing is left out.
_BAND = 6.0
# Only this many of the steepest pixels in each square of this side, px, are used, so that no single
# object dominates.
_CELL_PX, _PER_CELL = 16, 12
# Sine of the angle below the horizon: ground farther off shows little of the translation, and
# is hidden by objects standing on it.
_LEAST_SLOPE = 0.14
_MARGIN_PX = 8
_ROUNDS = 8
# Pixels, one standard deviation: deviation of an edge from the plane, as no ground is quite flat.
_EDGE_SIGMA_PX = 0.3
_LEAST_NOISE = 0.5
# Standard deviations: residuals beyond this are outliers and get little weight.
_WIDTH = 2.5
# Required for a result: number of pixels, the share of them that agrees, and the explained share
# of the image's variation.
_LEAST_PIXELS, _LEAST_AGREEING, _LEAST_EXPLAINED = 150, 0.7, 0.6
# Metres: last step of a search that has converged, and step below which iteration stops.
_SETTLED_M, _FINE_M = 0.002, 0.0002
_NEAREST_M = 0.1
# Errors that all pixels share, as a share of the distance: changes in height, and the lens.
DISTANCE_SHARED = 0.02


@dataclass(frozen=True, eq=False)
class GroundMotion:
    """The camera's motion over the ground in metres.

    Attributes:
        T_now_mark: the motion. covariance: (6, 6) as a rotation vector (rad) and a translation (m)
            in the camera's axes now.
    """

    T_now_mark: Pose
    covariance: Float64Array

    @property
    def distance_m(self) -> float:
        """Length of the translation, metres."""
        return float(np.linalg.norm(self.T_now_mark.translation))

    @property
    def distance_sigma(self) -> float:
        """One standard deviation of the length, as a share of it; infinite if the length is 0."""
        distance_m = self.distance_m
        if distance_m < 1e-6:
            return float("inf")
        along = self.T_now_mark.translation / distance_m
        variance = float(along @ self.covariance[3:, 3:] @ along)
        return float(np.hypot(np.sqrt(variance) / distance_m, DISTANCE_SHARED))


class GroundMark:
    """The ground as seen in one image, the reference for later ones."""

    def __init__(self, image: Image, ground: GroundPlane, camera: StereoCamera) -> None:
        """``ground`` is the plane in the axes of the camera that took ``image`` (H, W), grey."""
        self._ground = ground
        self._camera = camera
        height, width = image.shape
        v, u = np.mgrid[0:height, 0:width]
        ray = np.stack(
            [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], axis=2
        )
        near = ray @ ground.down > _LEAST_SLOPE * np.linalg.norm(ray, axis=2)
        # Rows above this are skipped: all ground there is too far off.
        first = int(np.argmax(near.any(axis=1))) if near.any() else height - 1
        self._top = max(first - 4 * _MARGIN_PX, 0)
        self._levels = [
            self._chosen(image, ray[self._top :], near[self._top :], *level) for level in _LEVELS
        ]

    def aligned(self, image: Image, T_guess: Pose, turn_sigma: float) -> GroundMotion | None:
        """Return the camera's motion since the mark; None where the ground does not show it.

        Args:
            image: (H, W) grey, now. T_guess: initial estimate of the motion since the mark.
            turn_sigma: radians, its standard deviation about the vertical.
        """
        pose = T_guess
        for (smoothing, _), (place, value) in zip(_LEVELS, self._levels, strict=True):
            if len(value) < _LEAST_PIXELS:
                return None
            maps = _band_and_slopes(image[self._top :], smoothing)
            for _ in range(_ROUNDS):
                fit = self._fit(maps, smoothing, place, value, pose)
                information, pull = fit.information, fit.pull
                held, back = held_above_ground(pose, self._ground)
                down = pose.rotate(self._ground.down)
                turned = float((T_guess @ pose.inverse()).rotvec @ down)
                information = information + held
                information[:3, :3] += np.outer(down, down) / turn_sigma**2
                pull = pull + back
                pull[:3] += down * turned / turn_sigma**2
                step = np.linalg.lstsq(information, pull, rcond=1e-12)[0]
                pose = moved_by(pose, np.asarray(step, np.float64))
                if float(np.linalg.norm(step[3:])) < _FINE_M:
                    break
        settled = float(np.linalg.norm(step[3:])) < _SETTLED_M
        if not (settled and fit.count >= _LEAST_PIXELS):
            return None
        if fit.agreeing < _LEAST_AGREEING or fit.explained < _LEAST_EXPLAINED:
            return None
        return GroundMotion(pose, np.asarray(np.linalg.pinv(information), np.float64))

    def _chosen(
        self,
        image: Image,
        ray: Float64Array,
        near: NDArray[np.bool_],
        smoothing: float,
        least: float,
    ) -> tuple[Float64Array, _Float32Array]:
        """(N, 3) metres, camera frame: places of steep ground pixels, and (N,) their values.

        Args:
            ray: (h, W, 3) lines of sight of the rows in use; near: (h, W) which of them meet the
                ground near enough.
        """
        band, along_u, along_v = _band_and_slopes(image[self._top :], smoothing)
        steep = np.hypot(along_u, along_v)
        good = near & (steep > least)
        good[:_MARGIN_PX], good[-_MARGIN_PX:] = False, False
        good[:, :_MARGIN_PX], good[:, -_MARGIN_PX:] = False, False
        v, u = np.nonzero(good)
        cell = v // _CELL_PX * image.shape[1] + u // _CELL_PX
        kept = np.sort(_foremost(cell, -steep[v, u], _PER_CELL))
        sight = ray[v[kept], u[kept]]
        reach = self._ground.depth / (sight @ self._ground.down)
        return sight * reach[:, None], band[v[kept], u[kept]]

    def _fit(
        self,
        maps: tuple[_Float32Array, _Float32Array, _Float32Array],
        smoothing: float,
        place: Float64Array,
        value: _Float32Array,
        pose: Pose,
    ) -> _Fit:
        c = self._camera
        p = pose.apply(place)
        w = 1 / np.maximum(p[:, 2], _NEAREST_M)
        u, v = c.fx * p[:, 0] * w + c.cx, c.fy * p[:, 1] * w + c.cy - self._top
        height, width = maps[0].shape
        inside = (p[:, 2] > _NEAREST_M) & (u >= _MARGIN_PX) & (u < width - _MARGIN_PX)
        inside &= (v >= _MARGIN_PX) & (v < height - _MARGIN_PX)
        p, w, value = p[inside], w[inside], value[inside]
        if len(p) == 0:
            return _Fit(np.zeros((6, 6)), np.zeros(6), 0, 0.0, 0.0)
        at = u[inside].astype(np.float32)[None], v[inside].astype(np.float32)[None]
        band, along_u, along_v = (
            cv2.remap(each, *at, cv2.INTER_LINEAR)[0].astype(np.float64) for each in maps
        )
        r = value - band
        noise = max(MAD_TO_SIGMA * float(np.median(np.abs(r))), _LEAST_NOISE)
        variance = noise**2 + _EDGE_SIGMA_PX**2 * (along_u**2 + along_v**2)
        squared = r**2 / variance
        # The errors of smoothed pixels are correlated over the area of the filter.
        trust = 1 / (1 + squared / _WIDTH**2) ** 2 / (variance * 4 * np.pi * smoothing**2)
        by_place = np.empty((len(p), 3))
        by_place[:, 0], by_place[:, 1] = along_u * c.fx * w, along_v * c.fy * w
        by_place[:, 2] = -(by_place[:, 0] * p[:, 0] + by_place[:, 1] * p[:, 1]) * w
        turning = np.einsum("ni,nij->nj", by_place, -cross_matrix(p))
        J = np.concatenate([turning, by_place], axis=1)
        weighted = J * trust[:, None]
        explained = 1 - float((trust * r**2).sum() / max((trust * value**2).sum(), 1e-12))
        agreeing = float(np.mean(squared < _WIDTH**2))
        return _Fit(J.T @ weighted, weighted.T @ r, len(p), agreeing, explained)


@dataclass(frozen=True, eq=False)
class _Fit:
    """Normal equations (6, 6), (6,), and how well ``count`` pixels fitted before the step."""

    information: Float64Array
    pull: Float64Array
    count: int
    agreeing: float
    explained: float


def _band_and_slopes(
    image: Image, smoothing: float
) -> tuple[_Float32Array, _Float32Array, _Float32Array]:
    """(H, W) band-pass filtered grey levels, and their slopes along u and v."""
    grey = image.astype(np.float32)
    broad = 2 * round(_BAND * smoothing) + 1
    band = cv2.GaussianBlur(grey, (0, 0), smoothing) - cv2.blur(grey, (broad, broad))
    along_u, along_v = (cv2.Sobel(band, cv2.CV_32F, *d, scale=1 / 8) for d in ((1, 0), (0, 1)))
    return (
        np.asarray(band, np.float32),
        np.asarray(along_u, np.float32),
        np.asarray(along_v, np.float32),
    )


def _foremost(cell: NDArray[np.intp], key: _Float32Array, most: int) -> NDArray[np.intp]:
    """Return the indices of up to ``most`` items per cell (N,) with the smallest keys (N,)."""
    order = np.lexsort((key, cell))
    ordered = cell[order]
    first = np.searchsorted(ordered, ordered, side="left")
    return np.asarray(order[np.arange(len(order)) - first < most], np.intp)
