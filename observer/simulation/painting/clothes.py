"""Painters of clothes, skin and hair: the texture runs once around a limb, its rows down along it.

A material's colour is given by its options ``b``, ``g``, ``r``, and a second one by ``b2`` ...
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.simulation.painting.canvas import (
    Canvas,
    Float32Array,
    mix,
    smoothstep,
    spread,
)


def plain(canvas: Canvas) -> NDArray[np.uint8]:
    """One flat tone, with hardly a fold."""
    return canvas.finished(_cloth(canvas, folds=1.0, weave=0.4))


def folded(canvas: Canvas) -> NDArray[np.uint8]:
    """One tone with folds."""
    return canvas.finished(_cloth(canvas, folds=7.0, weave=1.0))


def denim(canvas: Canvas) -> NDArray[np.uint8]:
    """Twill, worn lighter down the front, with a seam along each side."""
    image = _cloth(canvas, folds=5.0, weave=4.0)
    around = canvas.columns() / canvas.size_m[0]
    worn = np.exp(-(((around - 0.5) / 0.12) ** 2)) * np.ones((canvas.height, 1), np.float32)
    image += spread(18 * worn * (0.7 + 0.3 * canvas.cloud(0.1, 2)))
    for side in (0.25, 0.75):
        seam = np.exp(-(((around - side) * canvas.size_m[0] / 0.003) ** 2))
        image -= spread(22 * seam * np.ones((canvas.height, 1), np.float32))
    return canvas.finished(image)


def striped(canvas: Canvas) -> NDArray[np.uint8]:
    """Stripes around the body."""
    image = _cloth(canvas, folds=3.0, weave=1.0)
    period = float(canvas.rng.uniform(0.025, 0.06))
    wave = np.sin(2 * np.pi * canvas.rows() / period) * np.ones((1, canvas.width), np.float32)
    return canvas.finished(mix(image, canvas.colour("2"), smoothstep(wave, -0.2, 0.2)))


def checked(canvas: Canvas) -> NDArray[np.uint8]:
    """Checks, as of a flannel shirt."""
    image = _cloth(canvas, folds=3.0, weave=2.0)
    period = float(canvas.rng.uniform(0.03, 0.07))
    rows = smoothstep(np.sin(2 * np.pi * canvas.rows() / period), -0.1, 0.1)
    columns = smoothstep(np.sin(2 * np.pi * canvas.columns() / period), -0.1, 0.1)
    return canvas.finished(mix(image, canvas.colour("2"), 0.45 * (rows + columns)))


def printed(canvas: Canvas) -> NDArray[np.uint8]:
    """A print of blots all over."""
    image = _cloth(canvas, folds=3.0, weave=1.0)
    blots = smoothstep(canvas.cloud(0.05, 3), 0.1, 0.3)
    image = mix(image, canvas.colour("2"), blots)
    dots = smoothstep(canvas.cloud(0.025, 2), 1.0, 1.2)
    return canvas.finished(mix(image, (235, 235, 235), 0.8 * dots))


def skin(canvas: Canvas) -> NDArray[np.uint8]:
    """Skin, nearly of one tone."""
    return canvas.finished(_cloth(canvas, folds=2.0, weave=1.0))


def hair(canvas: Canvas) -> NDArray[np.uint8]:
    """Strands from the crown down."""
    image = _cloth(canvas, folds=0.0, weave=0.0)
    return canvas.finished(image + spread(5 * canvas.noise(0.004, 0.06)))


def _cloth(canvas: Canvas, folds: float, weave: float) -> Float32Array:
    """A tone with folds and weave of these standard deviations, grey levels at middle grey."""
    colour = canvas.colour()
    image = canvas.filled(colour)
    brightness = max(0.25, sum(colour) / 3 / 110)
    shade = folds * canvas.noise(0.05, 0.14) + 0.6 * folds * canvas.noise(0.02, 0.05)
    fine = weave * canvas.noise(0.003, 0.003)
    image += spread(brightness * (shade + fine))
    return image
