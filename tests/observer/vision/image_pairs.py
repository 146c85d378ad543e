"""Rectified pairs of the built-in scenes, faults to put into them, and their row errors."""

from __future__ import annotations

import functools

import cv2
import numpy as np

from observer.camera import StereoCamera, as_gray
from observer.parameters import FeaturesParameters, StereoParameters
from observer.simulation.imaging import StereoImager
from observer.simulation.scenarios import load_scenario
from observer.simulation.world import World
from observer.vision.epipolar_error import EpipolarError, epipolar_error
from observer.vision.features import detect_features
from observer.vision.rectification import Rectification
from observer.vision.stereo import disparity_map, sample_disparity

Pair = tuple[np.ndarray, np.ndarray]
MAX_DISPARITY_PX = StereoParameters().max_disparity_px
CAMERA = StereoCamera(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)


@functools.cache
def scene(name: str) -> tuple[StereoCamera, tuple[Pair, ...]]:
    """Rectified grey pairs from the start, middle and end of a scenario."""
    world = World(load_scenario(name), 0)
    imager, rectification = StereoImager(world), Rectification(world.calibration)
    s = world.scenario
    pairs = []
    for index in (0, s.frame_count // 2, s.frame_count - 2):
        left, right = rectification.apply(*imager.pair(index, index / s.frame_rate))
        pairs.append((as_gray(left), as_gray(right)))
    return rectification.camera, tuple(pairs)


def turned(image: np.ndarray, degrees: float) -> np.ndarray:
    """Clockwise on the screen, about the principal point."""
    M = cv2.getRotationMatrix2D((CAMERA.cx, CAMERA.cy), -degrees, 1.0)
    size = (image.shape[1], image.shape[0])
    return cv2.warpAffine(image, M, size, borderMode=cv2.BORDER_REFLECT)


def lowered(image: np.ndarray, rows: int) -> np.ndarray:
    if rows < 0:
        return lowered(image[::-1], -rows)[::-1]
    return cv2.copyMakeBorder(image, rows, 0, 0, 0, cv2.BORDER_REFLECT)[: image.shape[0]]


def noisy(image: np.ndarray, sigma: float = 3.0) -> np.ndarray:
    noise = np.random.default_rng(0).normal(0, sigma, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def with_gamma(image: np.ndarray, gamma: float) -> np.ndarray:
    return (255 * (image / 255.0) ** gamma).astype(np.uint8)


def measured_rows(pair: Pair, camera: StereoCamera) -> EpipolarError | None:
    """Row errors of features as sparse stereo finds them, by Lucas-Kanade from left to right."""
    left, right = pair
    px = detect_features(left, FeaturesParameters(max_count=300)).px
    start = sample_disparity(disparity_map(left, right, StereoParameters()), px)
    px, start = px[np.isfinite(start)], start[np.isfinite(start)]
    guess = px - np.stack([start, np.zeros_like(start)], axis=1).astype(np.float32)
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        left, right, px, guess, winSize=(15, 15), maxLevel=1, flags=cv2.OPTFLOW_USE_INITIAL_FLOW
    )
    kept = status[:, 0] > 0
    return epipolar_error(px[kept], px[kept, 1] - found[kept, 1], camera)
