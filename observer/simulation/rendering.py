"""Pictures of the world: textured facets drawn by homography, at the speed of the demonstration.

Each facet is cut into bands of similar depth; each band takes the pyramid level that suits it
(supersampled along the direction in which it is foreshortened), is warped by its homography
within its bounding box, and is blended by its pixels' coverage. The room is convex and seen from
inside, so nothing of it hides another part of it; bodies are drawn from far to near, and a buffer
of inverse depth, which is an affine function of the pixel on every plane, decides between them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array, Pose
from observer.simulation.batches import FacetBatch, SeenFacet, View, Window
from observer.simulation.facets import Facet, Material, Part
from observer.simulation.polygons import (
    Corner,
    Float32Array,
    ImageCorner,
    clip_depth,
    coverage,
)
from observer.simulation.textures import Level, Texture, paint
from observer.simulation.world import Body, World

Image = NDArray[np.uint8]

NEAR_M = 0.04
# A band's farthest point is at most this much farther than its nearest one.
_BAND_RATIO = 1.8
# Neighbouring bands show the same, so that their overlap is not seen and saves blending them.
_BAND_OVERLAP_PX = 3.0
# Foreshortening up to this factor needs no supersampling, beyond the second is left to the
# pyramid, and in windows below this many pixels it is not worth its cost.
_FORESHORTENING = 1.7
_MOST_SUPERSAMPLES = 4
_SUPERSAMPLED_PX = 200
# Parts that overlap by less than this share of their depth are decided by the drawing order.
_DEPTH_BIAS = 1.02
_SIDE_LIGHT = np.array([-0.6, 0.8])


class Renderer:
    """Draws one world; keeps its textures."""

    def __init__(self, world: World) -> None:
        self._world = world
        posters = [Part((poster,)) for poster in world.posters]
        self._room = _Thing(None, (world.room, *posters))
        self._things = tuple(_Thing(body, body.parts) for body in world.bodies)
        shadows = [_Thing(b, (Part((b.shadow,)),)) for b in world.bodies if b.shadow is not None]
        self._shadows = tuple(shadows)
        self._textures: dict[int, Texture] = {}
        self._painted: dict[tuple[Material, tuple[float, float]], Texture] = {}

    def draw(self, view: View, T_room_camera: Pose, time: float, image: Image) -> None:
        """Draw the view's rows at ``time`` into ``image`` (H, W, 3) BGR; all of them are covered.

        Pixels of moving bodies are where the bodies are at ``time``.
        """
        R = T_room_camera.rotation.T
        eye = T_room_camera.translation
        t = -R @ eye
        drawing = _Drawing(self, view, image)
        for facet, seen in self._room.visible(R, t, eye, view):
            drawing.facet(facet, seen, 1.0, hides=False)
        poses: dict[int, tuple[Float64Array, Float64Array, Float64Array, Pose]] = {}
        for body in self._world.bodies:
            T_room_body = body.T_room_body(time)
            eye_body = T_room_body.rotation.T @ (eye - T_room_body.translation)
            R_body = R @ T_room_body.rotation
            poses[body.id] = (R_body, R @ T_room_body.translation + t, eye_body, T_room_body)
        for shadow in self._shadows:
            for facet, seen in shadow.visible(*poses[shadow.id][:3], view):
                drawing.shadow(facet, seen)
        ordered: list[tuple[float, _Thing, int, list[SeenFacet | None]]] = []
        for thing in self._things:
            R_body, t_body, eye_body, _ = poses[thing.id]
            if thing.batch.outside(R_body, t_body, view):
                continue
            all_seen = thing.batch.seen(R_body, t_body, eye_body, view, NEAR_M)
            for k, part in enumerate(thing.parts):
                to_eye = part.centre - eye_body
                first = thing.batch.starts[k]
                seen_part = all_seen[first : first + len(part.facets)]
                ordered.append((float(to_eye @ to_eye), thing, k, seen_part))
        ordered.sort(key=lambda item: -item[0])
        for _, thing, k, seen_part in ordered:
            T_room_body = poses[thing.id][3]
            for facet, one in zip(thing.parts[k].facets, seen_part, strict=True):
                if one is not None:
                    gain = _light(T_room_body.rotation @ facet.normal)
                    drawing.facet(facet, one, gain, hides=True)
            drawing.hide_behind()

    def texture(self, facet: Facet) -> Texture:
        """The texture of a facet, painted at its first use."""
        # Facets live as long as the world, so their identity is a key.
        found = self._textures.get(id(facet))
        if found is None:
            key = (facet.material, facet.extent)
            found = self._painted.get(key)
            if found is None:
                found = self._painted[key] = paint(facet.material, facet.extent)
            self._textures[id(facet)] = found
        return found


class _Thing:
    """Parts that move together, with their arithmetic; ``body`` is None for the room."""

    def __init__(self, body: Body | None, parts: Sequence[Part]) -> None:
        self.id = -1 if body is None else body.id
        self.parts = tuple(parts)
        self.batch = FacetBatch(self.parts)
        self._facets = tuple(facet for part in self.parts for facet in part.facets)

    def visible(
        self, R: Float64Array, t: Float64Array, eye: Float64Array, view: View
    ) -> Iterator[tuple[Facet, SeenFacet]]:
        """The facets that may be in the image, in their order."""
        if self.batch.outside(R, t, view):
            return
        for facet, seen in zip(self._facets, self.batch.seen(R, t, eye, view, NEAR_M), strict=True):
            if seen is not None:
                yield facet, seen


class _Drawing:
    """One image while it is being drawn."""

    def __init__(self, renderer: Renderer, view: View, image: Image) -> None:
        self._renderer = renderer
        self._view = view
        self._image = image
        self._blank = True
        self._inverse_depth = np.zeros((view.height, view.width), np.float32)
        self._pending: list[tuple[Float32Array, Float32Array, NDArray[np.bool_]]] = []

    def facet(self, facet: Facet, seen: SeenFacet, gain: float, hides: bool) -> None:
        """Draw one facet, ``gain`` times as bright as its texture."""
        if seen.nearest >= NEAR_M and seen.farthest <= _BAND_RATIO * seen.nearest:
            self._band(facet, seen, seen.image_corners, gain, 1 / seen.nearest if hides else None)
            return
        for band in _bands(seen):
            nearest = 1 / min([corner[2] for corner in band]) if hides else None
            self._band(facet, seen, self._project(band), gain, nearest)

    def shadow(self, facet: Facet, seen: SeenFacet) -> None:
        """Darken what lies below a body."""
        polygon = seen.corners
        if seen.nearest < NEAR_M:
            polygon = clip_depth(polygon, NEAR_M, True, 0.0)
        window = self._window(self._project(polygon))
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
        region = self._image[v0:v1, u0:u1]
        region[:] = cv2.multiply(region, light, scale=1 / 255)

    def _band(
        self,
        facet: Facet,
        seen: SeenFacet,
        corners: list[ImageCorner],
        gain: float,
        nearest: float | None,
    ) -> None:
        """Draw one band; ``nearest`` is its largest inverse depth, None where it hides nothing."""
        window = self._window(corners)
        if window is None:
            return
        u0, v0, u1, v1 = window
        # What is drawn first needs no edges: all around it is drawn later.
        share = None if self._blank else coverage(corners, u0, v0, u1 - u0, v1 - v0)
        self._blank = False
        if nearest is not None:
            share = self._visible(share, seen.texture_from_image, window, nearest)
            if share is None:
                return
        patch = self._warp(facet, seen.texture_from_image, window, corners)
        if gain != 1.0:
            patch = np.asarray(cv2.convertScaleAbs(patch, alpha=gain), np.uint8)
        region = self._image[v0:v1, u0:u1]
        if share is None:
            region[:] = patch
        else:
            region[:] = cv2.blendLinear(patch, region, share, 1 - share)

    def _visible(
        self, share: Float32Array | None, m: list[float], window: Window, nearest: float
    ) -> Float32Array | None:
        """Coverage left in front of what was drawn before; None where nothing is left."""
        u0, v0, u1, v1 = window
        us = np.arange(u0, u1, dtype=np.float32)
        vs = np.arange(v0, v1, dtype=np.float32)[:, None]
        depth = us * np.float32(m[6]) + (vs * np.float32(m[7]) + np.float32(m[8]))
        # Beyond its own edges a plane goes on towards the eye; the facet does not.
        np.minimum(depth, np.float32(nearest), out=depth)
        behind = self._inverse_depth[v0:v1, u0:u1]
        free = depth * np.float32(_DEPTH_BIAS) > behind
        if share is None:
            share = free.astype(np.float32)
        else:
            share *= free
        if not share.any():
            return None
        self._pending.append((behind, depth, share >= 0.5))
        return share

    def hide_behind(self) -> None:
        """Let the part whose facets were drawn since the last call hide what is drawn later.

        Not before: the facets of one convex part do not hide each other, but each is drawn a
        little beyond the edges that it shares with the next.
        """
        for behind, depth, solid in self._pending:
            np.maximum(behind, depth, out=behind, where=solid)
        self._pending.clear()

    def _warp(
        self, facet: Facet, m: list[float], window: Window, corners: list[ImageCorner]
    ) -> Image:
        """The facet's texture over a window, without aliasing."""
        u0, v0, u1, v1 = window
        w, h = u1 - u0, v1 - v0
        # Chosen by what the whole image shows of the band, so that rows drawn by themselves
        # look as they do in the whole.
        us = [min(max(c[0], 0.0), self._view.width) for c in corners]
        vs = [min(max(c[1], 0.0), self._view.height) for c in corners]
        pixels = (max(us) - min(us)) * (max(vs) - min(vs))
        n = len(corners)
        level, nu, nv = self._level(facet, m, sum(us) / n, sum(vs) / n, pixels)
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
        """Pyramid level, and samples along u and v, that suit the texture about pixel (u, v)."""
        c = m[6] * u + m[7] * v + m[8]
        s = (m[0] * u + m[1] * v + m[2]) / c
        t = (m[3] * u + m[4] * v + m[5]) / c
        along_u = math.hypot(m[0] - s * m[6], m[3] - t * m[6]) / abs(c)
        along_v = math.hypot(m[1] - s * m[7], m[4] - t * m[7]) / abs(c)
        fine = max(min(along_u, along_v), 1e-9)
        nu = nv = 1
        if pixels >= _SUPERSAMPLED_PX:
            nu = min(_MOST_SUPERSAMPLES, max(1, round(along_u / fine / _FORESHORTENING)))
            nv = min(_MOST_SUPERSAMPLES, max(1, round(along_v / fine / _FORESHORTENING)))
        coarse = max(along_u / nu, along_v / nv, fine)
        # Between the two: a little blur across is less disturbing than shimmer along.
        level = self._renderer.texture(facet).level(1 / math.sqrt(fine * coarse))
        return level, nu, nv

    def _project(self, polygon: list[Corner]) -> list[ImageCorner]:
        v = self._view
        return [(v.fx * x / z + v.cx, v.fy * y / z + v.cy, g) for x, y, z, g in polygon]

    def _window(self, corners: list[ImageCorner]) -> Window | None:
        if not corners:
            return None
        us = [c[0] for c in corners]
        vs = [c[1] for c in corners]
        return self._view.window(min(us), min(vs), max(us), max(vs))


def _bands(seen: SeenFacet) -> list[list[Corner]]:
    """The facet cut by depth, from far to near; what lies before the near plane is left out."""
    polygon, nearest, farthest = seen.corners, seen.nearest, seen.farthest
    if nearest < NEAR_M:
        polygon = clip_depth(polygon, NEAR_M, True, 0.0)
        nearest = NEAR_M
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
    """(3, 3) from a sample of a window to a pixel of a texture's level.

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


def _light(normal: Float64Array) -> float:
    """Brightness of a facet by its normal (3,) in the room: lamps above, a window to the left."""
    up = max(0.0, float(normal[2]))
    side = 0.86 + 0.14 * float(normal[:2] @ _SIDE_LIGHT)
    return (1 - up) * side + up * 1.06
