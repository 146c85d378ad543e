"""Draws facets into an image: warped by homography, blended by coverage and depth.

Each facet is cut into bands of similar depth. Each band takes the pyramid level that fits it
(supersampled along the direction in which it is foreshortened, or both ways if its texture
asks for it), is warped by its homography within its bounding box, and is blended by its pixels'
coverage. Occlusion is decided by a buffer of inverse depth, which on every plane is an affine
function of the pixel.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.simulation.batches import SeenFacet, View, Window
from observer.simulation.facets import Facet
from observer.simulation.polygons import (
    Corner,
    Float32Array,
    ImageCorner,
    clip_depth,
    coverage,
)
from observer.simulation.textures import Level, Texture

Image = NDArray[np.uint8]

NEAR_M = 0.04
# Largest ratio of a band's farthest depth to its nearest one.
_BAND_RATIO = 1.8
# Neighbouring bands show the same texture, so their overlap is invisible and saves blending.
_BAND_OVERLAP_PX = 3.0
# Foreshortening up to the first factor needs no supersampling; beyond the second the pyramid
# handles it; in windows of fewer pixels than the third supersampling is not worth its cost.
_FORESHORTENING = 1.7
_MOST_SUPERSAMPLES = 4
_SUPERSAMPLED_PX = 200
# If depths differ by less than this ratio, the drawing order decides which part is in front.
_DEPTH_BIAS = 1.02


class Drawing:
    """One image while it is being drawn.

    Args:
        texture: returns the texture of a facet.
        image: (H, W, 3) BGR, drawn into.
        inverse_depth: (H, W) 1/m of what the image already shows; None for an empty image.
    """

    def __init__(
        self,
        texture: Callable[[Facet], Texture],
        view: View,
        image: Image,
        inverse_depth: Float32Array | None = None,
    ) -> None:
        self._texture = texture
        self.view = view
        self.image = image
        self._blank = inverse_depth is None
        if inverse_depth is None:
            inverse_depth = np.zeros((view.height, view.width), np.float32)
        self.inverse_depth = inverse_depth
        self._pending: list[tuple[Float32Array, Float32Array, NDArray[np.bool_]]] = []

    def facet(self, facet: Facet, seen: SeenFacet, gain: float, hides: bool) -> None:
        """Draw one facet, ``gain`` times as bright as its texture."""
        if seen.nearest >= NEAR_M and seen.farthest <= _BAND_RATIO * seen.nearest:
            nearest = 1 / seen.nearest if hides else None
            self._band(facet, seen, seen.image_corners, seen.bounds, gain, nearest)
            return
        for band in _bands(seen, self.view):
            corners = self._project(band)
            nearest = 1 / min([corner[2] for corner in band]) if hides else None
            self._band(facet, seen, corners, _bounds(corners), gain, nearest)

    def shadow(self, facet: Facet, seen: SeenFacet) -> None:
        """Darken the floor below a body."""
        corners = self._outline(seen)
        window = self.view.window(*_bounds(corners)) if corners else None
        if window is None:
            return
        u0, v0, u1, v1 = window
        m = seen.texture_from_image
        level, _, _ = self._level(facet, m, (u0 + u1) / 2, (v0 + v1) / 2, 0)
        light = cv2.warpPerspective(
            level.image,
            _level_from_window(m, level, u0, v0, 1, 1),
            (u1 - u0, v1 - v0),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=(255, 255, 255),
        )
        region = self.image[v0:v1, u0:u1]
        region[:] = cv2.multiply(region, light, scale=1 / 255)

    def cover(self, seen: SeenFacet) -> tuple[Window, Float32Array] | None:
        """Return a window around a facet and the share (h, w) of each pixel that it covers."""
        corners = self._outline(seen)
        window = self.view.window(*_bounds(corners)) if corners else None
        if window is None:
            return None
        u0, v0, u1, v1 = window
        share = coverage(corners, u0, v0, u1 - u0, v1 - v0)
        return window, np.ones((v1 - v0, u1 - u0), np.float32) if share is None else share

    def reflect(self, window: Window, mirror: Image, share: Float32Array) -> None:
        """Blend a window's reflection (h, w, 3) into it; the depth buffer stays unchanged."""
        u0, v0, u1, v1 = window
        region = self.image[v0:v1, u0:u1]
        region[:] = cv2.blendLinear(mirror, region, share, 1 - share)

    def _outline(self, seen: SeenFacet) -> list[ImageCorner]:
        """Return the corners of the part in front of the camera; none if all is behind it."""
        polygon = seen.corners
        if seen.nearest < NEAR_M:
            polygon = clip_depth(polygon, NEAR_M, True, 0.0)
        return self._project(polygon)

    def _band(
        self,
        facet: Facet,
        seen: SeenFacet,
        corners: list[ImageCorner],
        bounds: Sequence[float],
        gain: float,
        nearest: float | None,
    ) -> None:
        """Draw one band; ``nearest`` is its largest inverse depth, None where it hides nothing."""
        window = self.view.window(*bounds)
        if window is None:
            return
        u0, v0, u1, v1 = window
        # The first band needs no soft edges: everything around it is drawn later.
        share = None if self._blank else coverage(corners, u0, v0, u1 - u0, v1 - v0)
        self._blank = False
        if nearest is not None:
            share = self._visible(share, seen.texture_from_image, window, nearest)
            if share is None:
                return
        patch = self._warp(facet, seen.texture_from_image, window, bounds)
        if gain != 1.0:
            patch = np.asarray(cv2.convertScaleAbs(patch, alpha=gain), np.uint8)
        region = self.image[v0:v1, u0:u1]
        if share is None:
            region[:] = patch
        else:
            region[:] = cv2.blendLinear(patch, region, share, 1 - share)

    def _visible(
        self, share: Float32Array | None, m: list[float], window: Window, nearest: float
    ) -> Float32Array | None:
        """Return the coverage in front of what was drawn before; None if nothing is left."""
        u0, v0, u1, v1 = window
        us = np.arange(u0, u1, dtype=np.float32)
        vs = np.arange(v0, v1, dtype=np.float32)[:, None]
        depth = us * np.float32(m[6]) + (vs * np.float32(m[7]) + np.float32(m[8]))
        # Beyond the facet's edges its plane may come nearer to the eye than the facet does.
        np.minimum(depth, np.float32(nearest), out=depth)
        behind = self.inverse_depth[v0:v1, u0:u1]
        free = depth * np.float32(_DEPTH_BIAS) > behind
        if share is None:
            share = free.astype(np.float32)
        else:
            share *= free
        if not share.any():
            return None
        self._pending.append((behind, depth, share >= 0.5))
        return share

    def blend(
        self, window: Window, patch: Image, share: Float32Array, inverse_depth: Float32Array
    ) -> None:
        """Draw a patch (h, w, 3) that covers ``share`` (h, w) of each pixel, in front of the rest.

        Args:
            inverse_depth: (h, w) 1/m of what is drawn.
        """
        u0, v0, u1, v1 = window
        behind = self.inverse_depth[v0:v1, u0:u1]
        share = share * (inverse_depth >= behind)
        region = self.image[v0:v1, u0:u1]
        region[:] = cv2.blendLinear(patch, region, share, 1 - share)
        np.maximum(behind, inverse_depth, out=behind, where=share >= 0.5)

    def hide_behind(self) -> None:
        """Let the part whose facets were drawn since the last call hide what is drawn later.

        This waits until the part is complete: the facets of a convex part do not hide each other,
        but each is drawn slightly beyond the edges that it shares with its neighbours.
        """
        for behind, depth, solid in self._pending:
            np.maximum(behind, depth, out=behind, where=solid)
        self._pending.clear()

    def _warp(self, facet: Facet, m: list[float], window: Window, bounds: Sequence[float]) -> Image:
        """Warp the facet's texture over a window, without aliasing."""
        u0, v0, u1, v1 = window
        w, h = u1 - u0, v1 - v0
        # Choose by the band's extent in the whole image, so that rows drawn separately look the
        # same as in a full image.
        left, right = max(bounds[0], 0.0), min(bounds[2], self.view.width)
        above, below = max(bounds[1], 0.0), min(bounds[3], self.view.height)
        pixels = (right - left) * (below - above)
        level, nu, nv = self._level(facet, m, (left + right) / 2, (above + below) / 2, pixels)
        patch = cv2.warpPerspective(
            level.image,
            _level_from_window(m, level, u0, v0, nu, nv),
            (w * nu, h * nv),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        if nu > 1 or nv > 1:
            patch = cv2.resize(patch, (w, h), interpolation=cv2.INTER_AREA)
        return np.asarray(patch, np.uint8)

    def _level(
        self, facet: Facet, m: list[float], u: float, v: float, pixels: float
    ) -> tuple[Level, int, int]:
        """Choose the pyramid level, and the samples along u and v, for pixel (u, v)."""
        c = m[6] * u + m[7] * v + m[8]
        s = (m[0] * u + m[1] * v + m[2]) / c
        t = (m[3] * u + m[4] * v + m[5]) / c
        along_u = math.hypot(m[0] - s * m[6], m[3] - t * m[6]) / abs(c)
        along_v = math.hypot(m[1] - s * m[7], m[4] - t * m[7]) / abs(c)
        fine = max(min(along_u, along_v), 1e-9)
        texture = self._texture(facet)
        nu = nv = texture.samples
        if pixels >= _SUPERSAMPLED_PX:
            nu = min(_MOST_SUPERSAMPLES, max(nu, round(nu * along_u / fine / _FORESHORTENING)))
            nv = min(_MOST_SUPERSAMPLES, max(nv, round(nv * along_v / fine / _FORESHORTENING)))
        fine = max(min(along_u / nu, along_v / nv), 1e-9)
        coarse = max(along_u / nu, along_v / nv, fine)
        # Geometric mean: a little blur across is less disturbing than aliasing along.
        return texture.level(1 / math.sqrt(fine * coarse)), nu, nv

    def _project(self, polygon: list[Corner]) -> list[ImageCorner]:
        v = self.view
        return [(v.fx * x / z + v.cx, v.fy * y / z + v.cy, g) for x, y, z, g in polygon]


def _bounds(corners: list[ImageCorner]) -> tuple[float, float, float, float]:
    """Return the smallest u and v and the largest u and v."""
    us = [c[0] for c in corners]
    vs = [c[1] for c in corners]
    return min(us), min(vs), max(us), max(vs)


def _bands(seen: SeenFacet, view: View) -> list[list[Corner]]:
    """Cut the facet by depth, from far to near; leave out what is certainly outside the image."""
    m = seen.texture_from_image
    # The plane's largest inverse depth within the image is at an image corner. All rows count,
    # so that rows drawn separately are cut as in a full image.
    largest = m[8] + max(-m[6], m[6] * view.width) + max(-m[7], m[7] * view.height)
    if largest <= 0:
        return []
    polygon, nearest, farthest = seen.corners, seen.nearest, seen.farthest
    least = max(NEAR_M, 0.98 / largest)
    if nearest < least:
        polygon = clip_depth(polygon, least, True, _BAND_OVERLAP_PX)
        nearest = least
    bands = []
    far = farthest
    while polygon:
        far /= _BAND_RATIO
        if far <= nearest * 1.05:
            bands.append(polygon)
            break
        band = clip_depth(polygon, far, True, _BAND_OVERLAP_PX)
        if band:
            bands.append(band)
        polygon = clip_depth(polygon, far, False, _BAND_OVERLAP_PX)
    return bands


def _level_from_window(
    m: list[float], level: Level, u0: int, v0: int, nu: int, nv: int
) -> Float64Array:
    """Return the (3, 3) homography from a window's sample to a pixel of a texture's level.

    Pixel u of the window is the mean of its nu samples, so sample k lies at
    u0 + (k + 0.5) / nu - 0.5, and v likewise.
    """
    rows = []
    for a, b, c in (
        (level.sx * m[0] - 0.5 * m[6], level.sx * m[1] - 0.5 * m[7], level.sx * m[2] - 0.5 * m[8]),
        (level.sy * m[3] - 0.5 * m[6], level.sy * m[4] - 0.5 * m[7], level.sy * m[5] - 0.5 * m[8]),
        (m[6], m[7], m[8]),
    ):
        shift_u, shift_v = u0 + 0.5 / nu - 0.5, v0 + 0.5 / nv - 0.5
        rows.append((a / nu, b / nv, c + a * shift_u + b * shift_v))
    return np.array(rows)
