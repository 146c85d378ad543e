"""Pictures of the world: textured facets drawn by homography, at the speed of the demonstration.

Each facet is cut into bands of similar depth; each band takes the pyramid level that suits it
(supersampled along the direction in which it is foreshortened), is warped by its homography
within its bounding box, and is blended by its pixels' coverage. The room is convex and seen from
inside, so nothing of it hides another part of it; bodies are drawn from far to near, and a buffer
of inverse depth, which is an affine function of the pixel on every plane, decides between them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array, Pose
from observer.simulation.facets import Facet, Material, Part
from observer.simulation.polygons import Corner, Float32Array, clip_depth, coverage
from observer.simulation.textures import Level, Texture, paint
from observer.simulation.world import World

Image = NDArray[np.uint8]

NEAR_M = 0.04
# A band's farthest point is at most this much farther than its nearest one.
_BAND_RATIO = 1.8
# Neighbouring bands show the same, so that their overlap is not seen and saves blending them.
_BAND_OVERLAP_PX = 3.0
# Foreshortening beyond this factor is left to the pyramid.
_MOST_SUPERSAMPLES = 4
# Foreshortening up to this factor needs no supersampling.
_FORESHORTENING = 1.7
# Parts that overlap by less than this share of their depth are decided by the drawing order.
_DEPTH_BIAS = 1.02
_SIDE_LIGHT = np.array([-0.6, 0.8])


@dataclass(frozen=True, eq=False)
class View:
    """A pinhole camera at one instant.

    Attributes:
        width, height: of the whole image, pixels. fx, fy, cx, cy: pixels; (0, 0) is the centre
            of the first pixel.
        T_room_camera: its pose.
        rows: the range of rows that is drawn; all of them unless a rolling shutter reads out.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    T_room_camera: Pose
    rows: tuple[int, int]

    @property
    def K(self) -> Float64Array:
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])


class Renderer:
    """Draws one world; keeps its textures."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._posters = tuple(Part((poster,)) for poster in world.posters)
        self._textures: dict[int, Texture] = {}
        self._painted: dict[tuple[Material, tuple[float, float]], Texture] = {}

    def draw(self, view: View, time: float, image: Image) -> None:
        """Draw the rows of ``view`` at ``time`` into ``image`` (H, W, 3) BGR, covering them."""
        T_camera_room = view.T_room_camera.inverse()
        eye = view.T_room_camera.translation
        drawing = _Drawing(self, view, image)
        room = _Placement(T_camera_room.rotation, T_camera_room.translation, None, eye)
        drawing.part(self._world.room, room)
        for poster in self._posters:
            drawing.part(poster, room)
        ordered: list[tuple[float, Part, _Placement]] = []
        for body in self._world.bodies:
            T_room_body = body.T_room_body(time)
            R = T_camera_room.rotation @ T_room_body.rotation
            t = T_camera_room.rotation @ T_room_body.translation + T_camera_room.translation
            eye_body = T_room_body.rotation.T @ (eye - T_room_body.translation)
            placement = _Placement(R, t, T_room_body.rotation, eye_body)
            if body.shadow is not None:
                drawing.shadow(body.shadow, placement)
            for part in body.parts:
                to_eye = part.centre - eye_body
                ordered.append((float(to_eye @ to_eye), part, placement))
        ordered.sort(key=lambda item: -item[0])
        for _, part, placement in ordered:
            drawing.part(part, placement)

    def texture(self, facet: Facet) -> Texture:
        """The texture of a facet, painted at its first use."""
        found = self._textures.get(id(facet))
        if found is None:
            # Facets live as long as the world, so their identity is a key.
            key = (facet.material, facet.extent)
            found = self._painted.get(key)
            if found is None:
                found = self._painted[key] = paint(facet.material, facet.extent)
            self._textures[id(facet)] = found
        return found


@dataclass(frozen=True, eq=False)
class _Placement:
    """Where a part is while one image is drawn.

    Attributes:
        R, t: ``T_camera_part``. R_room: rotation ``R_room_part`` for the light; None for the
            room, whose light is painted and which hides nothing. eye: (3,) in the part's frame.
    """

    R: Float64Array
    t: Float64Array
    R_room: Float64Array | None
    eye: Float64Array


class _Drawing:
    """One image while it is being drawn."""

    def __init__(self, renderer: Renderer, view: View, image: Image) -> None:
        self._renderer = renderer
        self._view = view
        self._K = view.K
        self._image = image
        self._blank = True
        self._inverse_depth = np.zeros((view.height, view.width), np.float32)

    def part(self, part: Part, placement: _Placement) -> None:
        """Draw the facets of a convex part that face the eye."""
        R, t = placement.R, placement.t
        if float(R[2] @ part.centre + t[2]) < NEAR_M - part.radius:
            return
        facing = (part.facing(placement.eye) > 1e-6).tolist()
        for index, facet in enumerate(part.facets):
            if not facing[index]:
                continue
            points = (facet.vertices @ R.T + t).tolist()
            polygon: list[Corner] = [
                (x, y, z, 1.0 if n is not None and n > index and facing[n] else 0.0)
                for (x, y, z), n in zip(points, facet.neighbours, strict=True)
            ]
            bands = [
                (band, corners, window)
                for band in _bands(polygon)
                if (window := self._window(corners := self._project(band))) is not None
            ]
            if not bands:
                continue
            inverse = self._texture_from_image(facet, placement)
            lit = placement.R_room
            gain = 1.0 if lit is None else _light(lit @ facet.normal)
            for band, corners, window in bands:
                nearest = None if lit is None else 1 / min(corner[2] for corner in band)
                self._band(facet, corners, window, inverse, gain, nearest)

    def shadow(self, facet: Facet, placement: _Placement) -> None:
        """Darken what lies below a body."""
        points = (facet.vertices @ placement.R.T + placement.t).tolist()
        polygon: list[Corner] = [(x, y, z, 0.0) for x, y, z in points]
        polygon = clip_depth(polygon, NEAR_M, True, 0.0)
        window = self._window(self._project(polygon))
        if window is None:
            return
        inverse = self._texture_from_image(facet, placement)
        u0, v0, u1, v1 = window
        level, _, _ = self._level(facet, inverse, (u0 + u1) / 2, (v0 + v1) / 2)
        light = cv2.warpPerspective(
            level.image,
            _texture_pixels(inverse, level.sx, level.sy) @ _shift(u0, v0),
            (u1 - u0, v1 - v0),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=(255, 255, 255),
        )
        region = self._image[v0:v1, u0:u1]
        region[:] = cv2.multiply(region, light, scale=1 / 255)

    def _texture_from_image(self, facet: Facet, placement: _Placement) -> Float64Array:
        """(3, 3) from an image pixel (u, v, 1) to (s, t, 1) / z: metres on the texture, depth."""
        A = placement.R @ facet.texture_frame
        A[:, 2] += placement.t
        return np.asarray(np.linalg.inv(self._K @ A), dtype=np.float64)

    def _band(
        self,
        facet: Facet,
        corners: list[tuple[float, float, float]],
        window: tuple[int, int, int, int],
        inverse: Float64Array,
        gain: float,
        nearest: float | None,
    ) -> None:
        """Draw one band; ``nearest`` is its largest inverse depth, None where it hides nothing."""
        u0, v0, u1, v1 = window
        # What is drawn first needs no edges: all around it is drawn later.
        share = None if self._blank else coverage(corners, u0, v0, u1 - u0, v1 - v0)
        self._blank = False
        if nearest is not None:
            share = self._visible(share, inverse[2], window, nearest)
            if share is None:
                return
        cu = sum([min(max(c[0], u0), u1) for c in corners]) / len(corners)
        cv = sum([min(max(c[1], v0), v1) for c in corners]) / len(corners)
        patch = self._warp(facet, inverse, window, cu, cv)
        if gain != 1.0:
            patch = np.asarray(cv2.convertScaleAbs(patch, alpha=gain), np.uint8)
        region = self._image[v0:v1, u0:u1]
        if share is None:
            region[:] = patch
        else:
            region[:] = cv2.blendLinear(patch, region, share, 1 - share)

    def _visible(
        self,
        share: Float32Array | None,
        plane: Float64Array,
        window: tuple[int, int, int, int],
        nearest: float,
    ) -> Float32Array | None:
        """Coverage left in front of what was drawn before; None where nothing is left.

        ``plane`` (3,) gives the inverse depth of the facet's plane at a pixel (u, v, 1).
        """
        u0, v0, u1, v1 = window
        us = np.arange(u0, u1, dtype=np.float32)
        vs = np.arange(v0, v1, dtype=np.float32)[:, None]
        depth = us * np.float32(plane[0]) + (vs * np.float32(plane[1]) + np.float32(plane[2]))
        # Beyond its own edges a plane goes on towards the eye; the facet does not.
        np.minimum(depth, np.float32(nearest), out=depth)
        behind = self._inverse_depth[v0:v1, u0:u1]
        free = depth * np.float32(_DEPTH_BIAS) > behind
        if share is None:
            share = free.astype(np.float32)
        else:
            share *= free
        solid = share >= 0.5
        if not solid.any() and not share.any():
            return None
        np.copyto(behind, depth, where=solid)
        return share

    def _warp(
        self,
        facet: Facet,
        inverse: Float64Array,
        window: tuple[int, int, int, int],
        cu: float,
        cv: float,
    ) -> Image:
        """The facet's texture over a window, without aliasing."""
        u0, v0, u1, v1 = window
        w, h = u1 - u0, v1 - v0
        level, nu, nv = self._level(facet, inverse, cu, cv)
        M = _texture_pixels(inverse, level.sx, level.sy) @ _shift(u0, v0)
        if nu > 1 or nv > 1:
            # Pixel u of the window is the mean of nu samples about it.
            M = M @ np.array(
                [[1 / nu, 0, (1 - nu) / (2 * nu)], [0, 1 / nv, (1 - nv) / (2 * nv)], [0, 0, 1.0]]
            )
        patch = cv2.warpPerspective(
            level.image,
            M,
            (w * nu, h * nv),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        if nu > 1 or nv > 1:
            patch = cv2.resize(patch, (w, h), interpolation=cv2.INTER_AREA)
        return np.asarray(patch, np.uint8)

    def _level(
        self, facet: Facet, inverse: Float64Array, u: float, v: float
    ) -> tuple[Level, int, int]:
        """Pyramid level, and samples along u and v, that suit the texture about pixel (u, v)."""
        m00, m01, m02, m10, m11, m12, m20, m21, m22 = inverse.ravel().tolist()
        c = m20 * u + m21 * v + m22
        s = (m00 * u + m01 * v + m02) / c
        t = (m10 * u + m11 * v + m12) / c
        along_u = math.hypot(m00 - s * m20, m10 - t * m20) / abs(c)
        along_v = math.hypot(m01 - s * m21, m11 - t * m21) / abs(c)
        fine = max(min(along_u, along_v), 1e-9)
        nu = min(_MOST_SUPERSAMPLES, max(1, round(along_u / fine / _FORESHORTENING)))
        nv = min(_MOST_SUPERSAMPLES, max(1, round(along_v / fine / _FORESHORTENING)))
        coarse = max(along_u / nu, along_v / nv, fine)
        # Between the two: a little blur across is less disturbing than shimmer along.
        level = self._renderer.texture(facet).level(1 / math.sqrt(fine * coarse))
        return level, nu, nv

    def _project(self, polygon: list[Corner]) -> list[tuple[float, float, float]]:
        v = self._view
        return [(v.fx * x / z + v.cx, v.fy * y / z + v.cy, g) for x, y, z, g in polygon]

    def _window(
        self, corners: list[tuple[float, float, float]]
    ) -> tuple[int, int, int, int] | None:
        """First and past-the-end pixel of the polygon's bounding box within the view."""
        if not corners:
            return None
        first, last = self._view.rows
        us = [c[0] for c in corners]
        vs = [c[1] for c in corners]
        margin = 1.0
        u0 = max(0, math.floor(max(min(us) - margin, -1.0)))
        v0 = max(first, math.floor(max(min(vs) - margin, -1.0)))
        u1 = min(self._view.width, math.ceil(min(max(us) + margin, 1e6)) + 1)
        v1 = min(last, math.ceil(min(max(vs) + margin, 1e6)) + 1)
        return (u0, v0, u1, v1) if u1 > u0 and v1 > v0 else None


def _bands(polygon: list[Corner]) -> list[list[Corner]]:
    """The polygon cut by depth, from far to near; what lies before the near plane is left out."""
    nearest = min(corner[2] for corner in polygon)
    farthest = max(corner[2] for corner in polygon)
    if farthest <= NEAR_M:
        return []
    if nearest < NEAR_M:
        polygon = clip_depth(polygon, NEAR_M, True, 0.0)
        nearest = NEAR_M
    if farthest <= _BAND_RATIO * nearest:
        return [polygon]
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


def _texture_pixels(inverse: Float64Array, sx: float, sy: float) -> Float64Array:
    """From image pixels to pixels of a texture's level."""
    return np.array([[sx, 0, -0.5], [0, sy, -0.5], [0, 0, 1.0]]) @ inverse


def _shift(u0: int, v0: int) -> Float64Array:
    return np.array([[1.0, 0, u0], [0, 1.0, v0], [0, 0, 1.0]])


def _light(normal: Float64Array) -> float:
    """Brightness of a facet by its normal (3,) in the room: lamps above, a window to the left."""
    up = max(0.0, float(normal[2]))
    side = 0.86 + 0.14 * float(normal[:2] @ _SIDE_LIGHT)
    return (1 - up) * side + up * 1.06
