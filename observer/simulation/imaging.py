"""Images as the two cameras deliver them: lens, shutter, exposure, gain, noise.

A frame's time is the middle of its exposure; with a rolling shutter, of its middle row's exposure.
"""

from __future__ import annotations

import math
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCalibration
from observer.geometry import Float64Array, Pose
from observer.simulation.batches import View
from observer.simulation.drawing import Image
from observer.simulation.rendering import Renderer
from observer.simulation.world import World

LEFT, RIGHT = 0, 1
# Rows rendered at one instant under a rolling shutter; motion within them stays below 0.2 px.
_STRIP_ROWS = 16
# Noise is read from a random offset in a precomputed stock: drawing new numbers for every pixel
# would cost as much as rendering the image.
_NOISE_STOCK_PX = 1 << 20
# Weights of the noise shared by the three colours and of each colour's own; chosen so that the
# grey value (0.114 b + 0.587 g + 0.299 r) has standard deviation 1.
_NOISE_COMMON = 0.9
_NOISE_APART = math.sqrt((1 - _NOISE_COMMON**2) / (0.114**2 + 0.587**2 + 0.299**2))


class StereoImager:
    """Both cameras of a world. Equal world, frame number and time give equal images."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._renderer = Renderer(world)
        c = world.true_calibration
        self._lenses = (_Lens(c, c.K1, c.D1), _Lens(c, c.K2, c.D2))

    @cached_property
    def _noise_stock(self) -> NDArray[np.int8]:
        rng = np.random.default_rng(np.random.SeedSequence([self._world.seed, 0xA01CE]))
        sigma = self._world.scenario.faults.noise
        apart = rng.standard_normal((_NOISE_STOCK_PX, 3), dtype=np.float32) * _NOISE_APART
        common = rng.standard_normal((_NOISE_STOCK_PX, 1), dtype=np.float32) * _NOISE_COMMON
        noise = np.clip(np.rint(sigma * (apart + common)), -127, 127)
        return np.asarray(noise, dtype=np.int8)

    def right_time(self, time: float) -> float:
        """Return the exposure time of the right camera for the frame of ``time``."""
        return time + self._world.scenario.faults.skew_s

    def pair(self, index: int, time: float) -> tuple[Image, Image]:
        """Render the left and right (H, W, 3) BGR images of frame ``index``."""
        later = self.right_time(time)
        return (
            self._finished(self.clean(LEFT, time), LEFT, index, time),
            self._finished(self.clean(RIGHT, later), RIGHT, index, later),
        )

    def clean(self, side: int, time: float) -> Image:
        """Render the image of one camera before gain, flicker and noise."""
        faults = self._world.scenario.faults
        if faults.exposure_s <= 0:
            return self._instant(side, time)
        n = faults.exposure_samples
        camera = self._world.scenario.camera
        total = np.zeros((camera.height, camera.width, 3), np.float32)
        for k in range(n):
            image = self._instant(side, time + faults.exposure_s * ((k + 0.5) / n - 0.5))
            cv2.accumulate(image, total)
        return np.asarray(cv2.convertScaleAbs(total, alpha=1 / n), np.uint8)

    def _instant(self, side: int, time: float) -> Image:
        lens = self._lenses[side]
        image = np.empty((lens.height, lens.width, 3), np.uint8)
        readout = self._world.scenario.faults.readout_s
        rows = lens.height if readout <= 0 else _STRIP_ROWS
        for first in range(0, lens.height, rows):
            last = min(first + rows, lens.height)
            middle = (first + last - 1) / 2 / (lens.height - 1)
            now = time + readout * (middle - 0.5)
            view = lens.view((first, last))
            self._renderer.draw(view, self._pose(side, now), now, image)
        return lens.through(image)

    def _pose(self, side: int, time: float) -> Pose:
        world = self._world
        return world.T_room_left(time) if side == LEFT else world.T_room_right(time)

    def _finished(self, image: Image, side: int, index: int, time: float) -> Image:
        faults = self._world.scenario.faults
        if faults.blur_px > 0:
            image = np.asarray(cv2.GaussianBlur(image, (0, 0), faults.blur_px), np.uint8)
        gain = self._world.brightness(time) * (1 + faults.gain if side == RIGHT else 1.0)
        if gain != 1.0:
            image = np.asarray(cv2.convertScaleAbs(image, alpha=gain), np.uint8)
        if faults.noise > 0:
            noise = self._noise(side, index, image.shape)
            image = np.asarray(cv2.add(image, noise, dtype=cv2.CV_8U), np.uint8)
        return image

    def _noise(self, side: int, index: int, shape: tuple[int, ...]) -> NDArray[np.int8]:
        rng = np.random.default_rng(np.random.SeedSequence([self._world.seed, index, side]))
        stock = self._noise_stock
        count = shape[0] * shape[1]
        if count > len(stock) // 2:
            stock = np.tile(stock, (2 * count // len(stock) + 1, 1))
        start = int(rng.integers(0, len(stock) - count))
        return stock[start : start + count].reshape(shape)


class _Lens:
    """One camera's lens: the geometry of the rendered pinhole image, and its distortion.

    Attributes:
        width, height: of the pinhole image, pixels; without distortion the camera's own.
    """

    def __init__(self, calibration: StereoCalibration, K: Float64Array, D: Float64Array) -> None:
        self._K = K
        self.width, self.height = calibration.width, calibration.height
        self._maps: tuple[NDArray[np.int16], NDArray[np.uint16]] | None = None
        if not D.any():
            return
        rays = undistorted_rays(calibration.width, calibration.height, K, D)
        # The camera's own resolution: a finer image would alias when it is distorted.
        f = float(K[0, 0])
        low = rays.reshape(-1, 2).min(axis=0) * f - 2
        high = rays.reshape(-1, 2).max(axis=0) * f + 2
        self.width, self.height = (int(n) for n in np.ceil(high - low))
        self._K = np.array([[f, 0, -low[0]], [0, f, -low[1]], [0, 0, 1.0]])
        pixels = (rays * f - low).astype(np.float32)
        map_x, map_y = cv2.convertMaps(pixels[..., 0], pixels[..., 1], cv2.CV_16SC2)
        self._maps = (np.asarray(map_x, np.int16), np.asarray(map_y, np.uint16))

    def view(self, rows: tuple[int, int]) -> View:
        """Return the pinhole image's geometry, with ``rows`` to be drawn."""
        K = self._K
        return View(self.width, self.height, K[0, 0], K[1, 1], K[0, 2], K[1, 2], rows)

    def through(self, image: Image) -> Image:
        """Distort the pinhole image."""
        if self._maps is None:
            return image
        return np.asarray(cv2.remap(image, *self._maps, cv2.INTER_LINEAR), np.uint8)


def undistorted_rays(width: int, height: int, K: Float64Array, D: Float64Array) -> Float64Array:
    """Return (H, W, 2), the intersection of each pixel's ray with the plane z = 1."""
    u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    if not D.any():
        return np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1]], axis=-1)
    pixels = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 60, 1e-12)
    rays = cv2.undistortPointsIter(pixels, K, D, np.eye(3), np.eye(3), criteria)
    return np.asarray(rays, dtype=np.float64).reshape(height, width, 2)
