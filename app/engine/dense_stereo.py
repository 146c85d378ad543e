"""Dense stereo for display: its input pair, and the disparity and cloud computed from it.

None of it feeds back into an observation. If the method has already computed a disparity, that one
is used, together with the pose of its pair.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from app.contract.views import CloudHeader, FrameInstant
from app.engine.observed import Observed
from observer.camera import StereoCamera, as_gray
from observer.drawing import color_copy, obstacle_color, silhouette_mask, tint
from observer.parameters import StereoParameters
from observer.types import Image, Observation, Obstacle
from observer.vision.stereo import disparity_map, point_cloud

# On a 20 Mbit/s link, this many points ten times a second lag by 75 ms; 50000 lag by seconds.
MAX_POINTS = 20_000
# The longest frame distance of a pair, plus a few for dropped frames.
_REMEMBERED = 16
# Pixels times disparities searched. 512x256 with 96 disparities is 12.6 million and takes 24 ms of
# one core; 1242x375 would take 85 ms, ten times a second.
_MOST_COMPARISONS = 16_000_000
_FEWEST_DISPARITIES = 16
# Share of the obstacle colour in the pixels of a body.
_TINT = 0.5


@dataclass(frozen=True, eq=False)
class DensePair:
    """Rectified pair from which a cloud can be computed.

    Attributes:
        left: (H, W) grey or (H, W, 3) BGR. right: the same, or None if there is none.
        disparity: (H, W) pixels; None if the method has not computed it.
        instant: facts of this very pair. obstacles: obstacles reported in it.
        reasons: reasons given in the newest observation.
    """

    left: Image
    right: Image | None
    disparity: NDArray[np.float32] | None
    instant: FrameInstant
    obstacles: tuple[Obstacle, ...]
    camera: StereoCamera
    parameters: StereoParameters
    reasons: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class DenseStereo:
    """Disparity of a pair, perhaps on a coarser pixel grid than the pair's.

    Attributes:
        disparity: (h, w) pixels of this grid, NaN = unknown.
        image: (h, w) grey or (h, w, 3) BGR, the left image on this grid.
        camera: the rectified pair with images of this size.
        parameters: the stereo parameters with the largest disparity of this grid.
        coarseness: number of the pair's pixels along one pixel of this grid.
    """

    disparity: NDArray[np.float32]
    image: Image
    camera: StereoCamera
    parameters: StereoParameters
    coarseness: int


class PairKeeper:
    """Keeps recent observations, to match a disparity with its image and pose.

    A model that computes a dense disparity does so for the pair at t, the earlier of the two frames
    it compares, so the observations of the last frames are kept.
    """

    def __init__(self) -> None:
        self._seen: deque[tuple[Image, Observation]] = deque(maxlen=_REMEMBERED)

    def remember(self, observed: Observed) -> None:
        """Store the frame's observation for the disparity that a later frame may bring."""
        left = observed.trace.get("left")
        if left is not None:
            self._seen.append((left, observed.observation))

    def pair(self, observed: Observed) -> DensePair:
        """Return the pair whose disparity is known, else the newest pair."""
        trace = observed.trace
        left, right, shown = trace["left"], trace.get("right"), observed.observation
        disparity, time = trace.get("disparity"), trace.get("previous_time")
        seen = next((seen for seen in self._seen if seen[1].time == time), None)
        if disparity is not None and seen is not None:
            left, shown = seen
        else:
            disparity = None
        return DensePair(
            left=left,
            right=right,
            disparity=disparity,
            instant=_instant(shown),
            obstacles=shown.reported,
            camera=observed.camera,
            parameters=observed.parameters.stereo,
            reasons=observed.observation.reasons,
        )


def dense_stereo(pair: DensePair) -> DenseStereo | None:
    """Return the pair's disparity; None where there is no second image."""
    if pair.disparity is not None:
        return DenseStereo(pair.disparity, pair.left, pair.camera, pair.parameters, 1)
    if pair.right is None:
        return None
    factor = coarseness(pair.camera, pair.parameters)
    image, right = _coarser(pair.left, factor), _coarser(pair.right, factor)
    parameters = _coarser_search(pair.parameters, factor)
    disparity = disparity_map(as_gray(image), as_gray(right), parameters)
    return DenseStereo(disparity, image, _coarser_camera(pair.camera, factor), parameters, factor)


def coarseness(camera: StereoCamera, parameters: StereoParameters) -> int:
    """Return the binning factor along each side: 1 up to 512x256 by default, 2 for KITTI.

    It depends on sizes alone, not on the load of the machine.
    """
    factor = 1
    while _comparisons(camera, parameters, factor) > _MOST_COMPARISONS:
        factor += 1
    return factor


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points (N, 3) float32, metres, in the camera's frame, and their RGB colours (N, 3) uint8."""

    points: NDArray[np.float32]
    colors: NDArray[np.uint8]


def cloud_of(pair: DensePair, dense: DenseStereo) -> Cloud:
    """Return the cloud of a pair, with bodies tinted in the colours of their states."""
    image = _with_bodies(pair.obstacles, dense)
    return Cloud(*point_cloud(dense.disparity, image, dense.camera, dense.parameters, MAX_POINTS))


def cloud_value(
    pair: DensePair, dense: DenseStereo, cloud: Cloud
) -> tuple[CloudHeader, list[bytes]]:
    """Return header and payload as the cloud slot carries them."""
    header: CloudHeader = {
        **pair.instant,
        "count": len(cloud.points),
        "coarseness": dense.coarseness,
    }
    return header, [cloud.points.tobytes(), cloud.colors.tobytes()]


def _with_bodies(obstacles: tuple[Obstacle, ...], dense: DenseStereo) -> Image:
    """Return the image with those pixels tinted that lie on a body, by silhouette and depth."""
    image = dense.image
    for one in obstacles:
        if one.silhouette is None:
            continue
        # Silhouettes reach slightly beyond a body, onto the background.
        reach = float(np.linalg.norm(one.size)) / 2
        with np.errstate(divide="ignore", invalid="ignore"):
            on_body = np.abs(dense.camera.fb / dense.disparity - one.position_camera[2]) <= reach
        on_body &= silhouette_mask(one.silhouette, on_body.shape, dense.coarseness)
        if image is dense.image:
            image = color_copy(image)
        tint(image, on_body, obstacle_color(one.state, one.motion), _TINT)
    return image


def _comparisons(camera: StereoCamera, parameters: StereoParameters, factor: int) -> int:
    search = _coarser_search(parameters, factor).max_disparity_px
    return (camera.width // factor) * (camera.height // factor) * search


def _coarser_search(parameters: StereoParameters, factor: int) -> StereoParameters:
    search = max(_FEWEST_DISPARITIES, -(-parameters.max_disparity_px // factor))
    return parameters.model_copy(update={"max_disparity_px": search})


def _coarser(image: Image, factor: int) -> Image:
    """Return the mean of each ``factor`` by ``factor`` block; cut the rest at right and bottom."""
    if factor == 1:
        return image
    height, width = (side // factor for side in image.shape[:2])
    whole = image[: height * factor, : width * factor]
    small = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.uint8)


def _coarser_camera(camera: StereoCamera, factor: int) -> StereoCamera:
    # Pixel centres have integer coordinates; scaling is linear from the outer pixel edge.
    return replace(
        camera,
        width=camera.width // factor,
        height=camera.height // factor,
        fx=camera.fx / factor,
        fy=camera.fy / factor,
        cx=(camera.cx + 0.5) / factor - 0.5,
        cy=(camera.cy + 0.5) / factor - 0.5,
    )


def _instant(observation: Observation) -> FrameInstant:
    pose = observation.T_world_camera
    return {
        "frame": observation.frame,
        "time": observation.time,
        "received": observation.received,
        "segment": observation.segment,
        "T_world_camera": None if pose is None else pose.matrix.ravel().tolist(),
    }
