"""Oracle of ``observer.kernels.picture_shift``: the same by numpy and OpenCV's remap."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.robust import MAD_TO_SIGMA, median
from observer.types import Image

# Gauss-Newton ends at steps below this many cells, or after this many steps.
_LEAST_STEP, _STEPS = 0.01, 10
# Grey levels: least noise; and the standard deviations beyond which residuals count less.
_LEAST_NOISE, _FULL_SIGMAS = 1.0, 2.0
# Grey levels: differences are capped at this in the coarse search for a trunk.
_MOST_DIFFERENCE = 20.0
# A place beside the expected one is chosen only if its difference is less by this factor.
_CLEARLY_LESS = 0.8
# The Sobel operator returns eight times the step, and its squared weights sum to twelve.
_SOBEL_SCALE = 1 / 8
_GRADIENT_NOISE = 12 * _SOBEL_SCALE**2
_RIDGE = 1e-6


@dataclass(frozen=True, eq=False)
class View:
    """Cells (2, N), columns and rows, of an image (h, w)."""

    image: Image
    at: NDArray[np.intp]

    @cached_property
    def middle(self) -> Float64Array:
        """(2,) column and row."""
        return np.asarray(self.at.mean(axis=1))

    def found_in(
        self,
        image: Image,
        expected: Float64Array,
        standing: Float64Array,
        scale: float,
        reach: int,
    ) -> tuple[Float64Array, Float64Array] | None:
        """(2,) column and row in a later image and their covariance, as ``TrunkView.found_in``."""
        spread = (self.at - self.middle[:, None]) * scale
        place = self._roughly(image, expected, spread, reach)
        if place is None:
            return None
        # First by the noise of the edges, so that none of them is an outlier while the place is
        # far off; then precisely. The first fit gives the covariance.
        about = self._fitted(image, place, spread, self._steep)
        close = about and self._fitted(image, about[0], spread, np.ones_like(self._steep))
        if about is None or close is None:
            return None
        place, cov = close[0], about[1]
        stood = self._cost(image, standing, spread)
        if np.isinf(stood) or self._cost(image, place, spread) > _CLEARLY_LESS * stood:
            cov += np.outer(place - standing, place - standing)
        return place, cov

    def _fitted(
        self,
        image: Image,
        place: Float64Array,
        spread: Float64Array,
        chosen: NDArray[np.bool_],
    ) -> tuple[Float64Array, Float64Array] | None:
        """(2,) place of the middle near ``place``, and its covariance (2, 2), see ``found_in``.

        None if most of it has left the image, or all of it that shows where it is.

        Args:
            chosen: (N,) the cells whose differences give the noise.
        """
        J = self._gradient
        difference, inside = self._difference(image, place, spread)
        light = median(difference[inside])
        for _ in range(_STEPS):
            residual = difference - light
            telling = residual[inside & chosen]
            if not len(telling):
                return None
            noise = max(_LEAST_NOISE, MAD_TO_SIGMA * median(np.abs(telling)))
            weight = inside / (1 + (residual / (_FULL_SIGMAS * noise)) ** 2)
            weighted = J * weight[:, None]
            information = weighted.T @ J + np.eye(3) * _RIDGE
            step = np.linalg.solve(information, weighted.T @ residual)
            place, light = place - step[:2], light + step[2]
            if np.abs(step[:2]).max() < _LEAST_STEP:
                break
            difference, inside = self._difference(image, place, spread)
            if not _mostly(inside):
                return None
        return place, _covariance(information, noise, float(weight.sum()))

    def _roughly(
        self, image: Image, expected: Float64Array, spread: Float64Array, reach: int
    ) -> Float64Array | None:
        """(2,) expected place, or one some whole columns beside it that differs clearly less.

        None if outside the image.
        """
        best, least = None, np.inf
        for off in sorted(range(-reach, reach + 1), key=abs):
            place = expected + np.array([off, 0.0])
            cost = self._cost(image, place, spread)
            clearly = 1.0 if off == 0 else _CLEARLY_LESS
            if cost < clearly * least:
                best, least = place, cost / clearly
        return best

    def _cost(self, image: Image, place: Float64Array, spread: Float64Array) -> float:
        """Return the mean difference at a place, grey levels; infinite outside the image."""
        difference, inside = self._difference(image, place, spread)
        if not _mostly(inside):
            return np.inf
        known = difference[inside]
        return float(np.minimum(np.abs(known - median(known)), _MOST_DIFFERENCE).mean())

    @cached_property
    def _gradient(self) -> Float64Array:
        """(N, 3) grey levels per column, per row, and per grey level of light."""
        columns, rows = self.at
        across, down = (
            cv2.Sobel(self.image, cv2.CV_32F, *along, scale=_SOBEL_SCALE)[rows, columns]
            for along in ((1, 0), (0, 1))
        )
        return np.stack([across, down, np.ones(len(rows))], axis=1).astype(np.float64)

    @cached_property
    def _steep(self) -> NDArray[np.bool_]:
        """(N,) which cells show where it is.

        On plain clothes in front of a plain wall they are few and differ most: by the noise of
        all cells, just these would be outliers.
        """
        steepness = np.abs(self._gradient[:, :2]).sum(axis=1)
        return np.asarray(steepness >= steepness.mean())

    @cached_property
    def _levels(self) -> Float64Array:
        """(N,) grey levels of its cells."""
        return np.asarray(self.image[self.at[1], self.at[0]], np.float64)

    def _difference(
        self, image: Image, place: Float64Array, spread: Float64Array
    ) -> tuple[Float64Array, NDArray[np.bool_]]:
        """(N,) grey levels by which an image is brighter, and which cells are inside it.

        Args:
            place: (2,) of the middle. spread: (2, N) of the cells about it.
        """
        x, y = (spread + place[:, None]).astype(np.float32)
        now = np.asarray(cv2.remap(image, x, y, cv2.INTER_LINEAR)[:, 0], np.float64)
        height, width = image.shape
        inside = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
        return now - self._levels, inside


def _mostly(inside: NDArray[np.bool_]) -> bool:
    return 2 * int(np.count_nonzero(inside)) > len(inside)


def _covariance(information: Float64Array, noise: float, cells: float) -> Float64Array:
    """(2, 2) cells^2 of a place, light unknown; what noise adds to gradients is left out.

    Args:
        information: (3, 3) sums of products of gradients over ``cells``. noise: grey levels,
            of the difference of two images.
    """
    across = information[:2, 2]
    told = information[:2, :2] - np.outer(across, across) / information[2, 2]
    told -= np.eye(2) * (_GRADIENT_NOISE * cells * noise**2 / 2)
    values, axes = np.linalg.eigh(told)
    return np.asarray((axes * (noise**2 / np.maximum(values, _RIDGE))) @ axes.T, np.float64)
