"""What painters share: a float canvas, smooth noise, soft edges."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.simulation.facets import Material

Float32Array = NDArray[np.float32]
# Colours are blue, green, red from 0 to 255, as OpenCV has them.
Colour = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Canvas:
    """What a painter is given.

    Attributes:
        width, height: of the texture, pixels. density: pixels per metre.
        rng: the only source of randomness. material: with its options.
    """

    width: int
    height: int
    density: float
    rng: np.random.Generator
    material: Material

    @property
    def contrast(self) -> float:
        return self.material.number("contrast", 1.0)

    def filled(self, colour: Colour) -> Float32Array:
        """(height, width, 3) float32."""
        return np.full((self.height, self.width, 3), colour, dtype=np.float32)

    def noise(self, cell_x_m: float, cell_y_m: float) -> Float32Array:
        """(height, width) smooth noise, standard deviation about 1, blobs of the given size."""
        w = max(2, round(self.width / (cell_x_m * self.density)) + 2)
        h = max(2, round(self.height / (cell_y_m * self.density)) + 2)
        w, h = min(w, self.width), min(h, self.height)
        small = self.rng.standard_normal((h, w), dtype=np.float32)
        if (w, h) == (self.width, self.height):
            return small
        size = (self.width, self.height)
        return np.asarray(
            cv2.resize(small, size, interpolation=cv2.INTER_CUBIC) * 1.25, dtype=np.float32
        )

    def cloud(self, cell_m: float, octaves: int = 4) -> Float32Array:
        """(height, width) noise of several sizes, standard deviation about 1."""
        total = np.zeros((self.height, self.width), np.float32)
        weight = 1.0
        for k in range(octaves):
            cell = cell_m / 2**k
            total += weight * self.noise(cell, cell)
            weight *= 0.6
        return np.asarray(total / 1.3, dtype=np.float32)

    def px(self, metres: float) -> int:
        return round(metres * self.density)

    def rows(self) -> Float32Array:
        """(height, 1) distance from the upper edge, metres."""
        v = (np.arange(self.height, dtype=np.float32) + 0.5) / self.density
        return np.asarray(v[:, None], dtype=np.float32)

    def columns(self) -> Float32Array:
        """(1, width) distance from the left edge, metres."""
        u = (np.arange(self.width, dtype=np.float32) + 0.5) / self.density
        return np.asarray(u[None, :], dtype=np.float32)

    def finished(self, image: Float32Array, shade: Float32Array | None = None) -> NDArray[np.uint8]:
        """8 bit, its contrast about the mean colour scaled, then shaded.

        ``shade`` (height, width) or broadcastable multiplies: light is not texture, so the
        contrast does not scale it. The image is used up.
        """
        if self.contrast != 1.0:
            mean = image.mean(axis=(0, 1), keepdims=True)
            image -= mean
            image *= self.contrast
            image += mean
        if shade is not None:
            image *= spread(np.broadcast_to(shade, image.shape[:2]))
        image += 0.5
        return np.clip(image, 0, 255, out=image).astype(np.uint8)


def smoothstep(x: Float32Array, low: float, high: float) -> Float32Array:
    """0 below ``low``, 1 above ``high``, smooth between."""
    t = np.clip((x - low) / (high - low), 0, 1)
    return np.asarray(t * t * (3 - 2 * t), dtype=np.float32)


def spread(plane: Float32Array, weights: Colour | None = None) -> Float32Array:
    """(H, W, 3) from (H, W): the same in every colour, or weighted by colour.

    Far faster than numpy's broadcasting over a last axis of three.
    """
    if weights is None:
        return np.asarray(cv2.merge([plane, plane, plane]), dtype=np.float32)
    return np.asarray(cv2.merge([plane * np.float32(w) for w in weights]), dtype=np.float32)


def mix(image: Float32Array, colour: Colour | Float32Array, weight: Float32Array) -> Float32Array:
    """``image`` (H, W, 3) blended towards a colour by ``weight`` (H, W)."""
    w = spread(weight)
    return np.asarray(image + (np.asarray(colour, np.float32) - image) * w, dtype=np.float32)
