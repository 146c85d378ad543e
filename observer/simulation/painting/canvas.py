"""Tools of all painters: a float canvas, smooth noise, soft edges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.simulation.facets import Material

Float32Array = NDArray[np.float32]
FloatArray = NDArray[np.floating[Any]]
# Colours are blue, green, red from 0 to 255, as in OpenCV.
Colour = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Canvas:
    """Size, randomness and material that a painter paints with.

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

    def colour(self, which: str = "") -> Colour:
        """Return the colour of the material's options ``b``, ``g``, ``r``, or ``b2`` and so on."""
        b, g, r = (self.material.number(f"{c}{which}", 110.0) for c in "bgr")
        return b, g, r

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height, metres."""
        return self.width / self.density, self.height / self.density

    def filled(self, colour: Colour) -> Float32Array:
        """Return (height, width, 3) float32 of one colour."""
        return np.full((self.height, self.width, 3), colour, dtype=np.float32)

    def noise(self, cell_x_m: float, cell_y_m: float) -> Float32Array:
        """Return (height, width) smooth noise, standard deviation about 1, with blobs this big."""
        size = (self.width, self.height)
        w = min(max(2, round(self.width / (cell_x_m * self.density)) + 2), self.width)
        h = min(max(2, round(self.height / (cell_y_m * self.density)) + 2), self.height)
        small = self.rng.standard_normal((h, w), dtype=np.float32)
        if (w, h) == size:
            return small
        large = cv2.resize(small, size, interpolation=cv2.INTER_CUBIC)
        return np.asarray(large * 1.25, dtype=np.float32)

    def cloud(self, cell_m: float, octaves: int = 4) -> Float32Array:
        """Return (height, width) noise of several scales, standard deviation about 1."""
        total = np.zeros((self.height, self.width), np.float32)
        weight = 1.0
        for k in range(octaves):
            cell = cell_m / 2**k
            total += weight * self.noise(cell, cell)
            weight *= 0.6
        return np.asarray(total / 1.3, dtype=np.float32)

    def edge_distance(self) -> Float32Array:
        """Return (height, width) distances from the nearest edge, metres."""
        u, v = self.columns(), self.rows()
        w, h = self.size_m
        near = np.minimum(np.minimum(u, w - u), np.minimum(v, h - v))
        return np.asarray(near, dtype=np.float32)

    def px(self, metres: float) -> int:
        return round(metres * self.density)

    def rows(self) -> Float32Array:
        """Return (height, 1) distances from the upper edge, metres."""
        v = (np.arange(self.height, dtype=np.float32) + 0.5) / self.density
        return np.asarray(v[:, None], dtype=np.float32)

    def columns(self) -> Float32Array:
        """Return (1, width) distances from the left edge, metres."""
        u = (np.arange(self.width, dtype=np.float32) + 0.5) / self.density
        return np.asarray(u[None, :], dtype=np.float32)

    def finished(self, image: Float32Array, shade: Float32Array | None = None) -> NDArray[np.uint8]:
        """Scale the contrast about the mean colour, shade, and convert to 8 bit.

        ``shade``, (height, width) or broadcastable, multiplies the image; it is light, not
        texture, so the contrast does not scale it. The image is overwritten.
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
    """Return 0 below ``low``, 1 above ``high``, and a smooth step between."""
    t = np.clip((x - low) / (high - low), 0, 1)
    return np.asarray(t * t * (3 - 2 * t), dtype=np.float32)


def spread(plane: FloatArray, weights: Colour | None = None) -> Float32Array:
    """Return (H, W, 3) from (H, W): the same in every colour, or weighted by colour.

    Far faster than numpy's broadcasting over a last axis of three.
    """
    plane = np.asarray(plane, np.float32)
    if weights is None:
        return np.asarray(cv2.merge([plane, plane, plane]), dtype=np.float32)
    return np.asarray(cv2.merge([plane * np.float32(w) for w in weights]), dtype=np.float32)


def mix(image: Float32Array, colour: Colour | FloatArray, weight: FloatArray) -> Float32Array:
    """Blend an image (H, W, 3) towards a colour by ``weight`` (H, W)."""
    w = spread(weight)
    return np.asarray(image + (np.asarray(colour, np.float32) - image) * w, dtype=np.float32)
