"""Calibrations of crooked and of fisheye pairs, and spots to see with them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCalibration
from observer.types import Image

WIDTH, HEIGHT = 320, 240


def crooked(rotvec: tuple[float, float, float] = (0.01, -0.02, 0.015)) -> StereoCalibration:
    """A pair of unequal cameras with lens distortion and a rotated right camera."""
    return StereoCalibration(
        WIDTH,
        HEIGHT,
        K1=np.array([[260.0, 0, 158], [0, 262, 121], [0, 0, 1]]),
        D1=np.array([-0.28, 0.09, 0.001, -0.0005, 0.0]),
        K2=np.array([[264.0, 0, 163], [0, 263, 117], [0, 0, 1]]),
        D2=np.array([-0.25, 0.07, -0.001, 0.0008, 0.0]),
        R=np.asarray(cv2.Rodrigues(np.array(rotvec))[0], np.float64),
        T=np.array([-0.12, 0.003, 0.002]),
    )


def points_in_view(seed: int = 0, count: int = 40) -> NDArray[np.float64]:
    """(N, 3) metres, frame of the unrectified left camera, 1.5 to 6 m away."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(1.5, 6, count)
    return np.stack([z * rng.uniform(-0.4, 0.4, count), z * rng.uniform(-0.3, 0.3, count), z], 1)


def spots(px: NDArray[np.float64]) -> Image:
    """A Gaussian spot of 2.5 px at each sub-pixel position."""
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    image = np.zeros((HEIGHT, WIDTH))
    for x, y in px:
        image += 220 * np.exp(-((u - x) ** 2 + (v - y) ** 2) / (2 * 2.5**2))
    return np.clip(image, 0, 255).astype(np.uint8)


def centre_near(image: Image, px: NDArray[np.float64]) -> NDArray[np.float64]:
    u, v = np.round(px).astype(int)
    window = image[v - 7 : v + 8, u - 7 : u + 8].astype(float)
    dv, du = np.mgrid[-7:8, -7:8]
    return np.array(
        [u + (window * du).sum() / window.sum(), v + (window * dv).sum() / window.sum()]
    )


def fisheye(
    rotvec: tuple[float, float, float] = (0.01, -0.02, 0.015), focal: float = 150.0
) -> StereoCalibration:
    """Equidistant lenses of about 120 degrees across (160 at a focal length of 115)."""
    return StereoCalibration(
        WIDTH,
        HEIGHT,
        K1=np.array([[focal, 0, 158], [0, focal + 1, 121], [0, 0, 1]]),
        D1=np.array([0.02, -0.006, 0.002, -0.0004]),
        K2=np.array([[focal - 2, 0, 163], [0, focal - 1, 117], [0, 0, 1]]),
        D2=np.array([-0.01, 0.004, -0.001, 0.0002]),
        R=np.asarray(cv2.Rodrigues(np.array(rotvec))[0], np.float64),
        T=np.array([-0.12, 0.003, 0.002]),
        distortion_model="equidistant",
    )
