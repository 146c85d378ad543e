"""Draws a person: each ellipsoid with its outline's coverage, its cloth and the light on it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from observer.geometry import Float64Array, Pose
from observer.simulation.batches import View
from observer.simulation.drawing import Drawing, Image
from observer.simulation.facets import Material
from observer.simulation.lighting import light
from observer.simulation.people.ellipsoids import Ellipsoids, Silhouette, silhouettes
from observer.simulation.people.person import Person
from observer.simulation.polygons import Float32Array, FloatArray
from observer.simulation.textures import Texture

# 1/m: smallest inverse depth; nothing of a person is drawn farther away.
_LEAST_INVERSE = 1e-3

Texturing = Callable[[Material, tuple[float, float]], Texture]


@dataclass(frozen=True, eq=False)
class PersonDrawing:
    """Drawing of one person.

    Attributes:
        T_room: the body's pose in the room at a time.
        texture: paints a material over (around, along) metres.
    """

    person: Person
    T_room: Callable[[float], Pose]
    texture: Texturing

    def seen(self, T_room_camera: Pose, time: float) -> SeenPerson:
        """Return the person as one camera sees it at an instant."""
        shape = self.person.seen(T_room_camera.inverse() @ self.T_room(time), time)
        return SeenPerson(self, shape, silhouettes(shape), T_room_camera.rotation)


@dataclass(frozen=True, eq=False)
class SeenPerson:
    """A person in a camera's frame; ``R_room_camera`` rotates from it to the room's axes."""

    drawing: PersonDrawing
    shape: Ellipsoids
    outlines: list[Silhouette | None]
    R_room_camera: Float64Array

    def solids(self) -> Iterator[tuple[float, int]]:
        """Yield the squared distance from the eye, m^2, and the number of each limb in front."""
        for k, (centre, outline) in enumerate(zip(self.shape.centres, self.outlines, strict=True)):
            if outline is not None:
                yield float(centre @ centre), k

    def draw(self, limb: int, drawing: Drawing) -> None:
        """Draw one limb over everything farther away."""
        outline, view = self.outlines[limb], drawing.view
        assert outline is not None
        window = _window(outline, view)
        if window is None:
            return
        u0, v0, u1, v1 = window
        x = ((np.arange(u0, u1, dtype=np.float32) - view.cx) / view.fx).astype(np.float32)[None, :]
        y = ((np.arange(v0, v1, dtype=np.float32) - view.cy) / view.fy).astype(np.float32)[:, None]
        disc, inverse = outline.meet(x, y)
        share = _coverage(outline, disc, x, y, view)
        share[inverse <= 0] = 0.0
        if not share.any():
            return
        depth = 1 / np.maximum(inverse, _LEAST_INVERSE)
        sphere: list[FloatArray] = [
            float(o) + depth * (float(a) * x + (float(b) * y + float(c)))
            for o, (a, b, c) in zip(outline.o, outline.A, strict=True)
        ]
        cloth = self._cloth(limb, sphere, view.fx / outline.depth)
        G = outline.A @ self.R_room_camera.T
        normal = np.stack([_weighed(sphere, column) for column in G.T], axis=-1)
        normal /= np.sqrt(np.einsum("hwi,hwi->hw", normal, normal))[..., None]
        shade = light(normal).astype(np.float32)
        patch = cv2.multiply(cloth, cv2.merge([shade, shade, shade]), dtype=cv2.CV_8U)
        drawing.blend(window, np.asarray(patch, np.uint8), share, inverse.astype(np.float32))

    def _cloth(self, k: int, sphere: list[FloatArray], density: float) -> Image:
        """Sample the cloth at points of the unit sphere, given as three (H, W) coordinates."""
        person = self.drawing.person
        figure = person.figure
        limb, girth = figure.limbs[k], figure.girths[k]
        length = 2 * max(limb.from_top, limb.semi[2]) * figure.height
        texture = self.drawing.texture(person.outfit[limb.cloth], (girth, length))
        level = texture.level(density)
        # Once around, starting at the seam at the back.
        angle = cv2.phase(-sphere[0], sphere[1])
        around = angle * np.float32(girth * level.sx / (2 * math.pi)) - np.float32(0.5)
        top = limb.from_top * figure.height
        along = np.float32(level.sy) * (
            np.float32(top) - np.float32(self.shape.semi[k, 2]) * sphere[2]
        )
        image = cv2.remap(
            level.image,
            around.astype(np.float32),
            (along - np.float32(0.5)).astype(np.float32),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        return np.asarray(image, np.uint8)


def _coverage(
    outline: Silhouette, disc: FloatArray, x: FloatArray, y: FloatArray, view: View
) -> Float32Array:
    """(H, W) share of each pixel within the outline.

    The discriminant over its slope is the distance from the outline, pixels.
    """
    N = outline.N
    du = 2 / view.fx * (N[0, 0] * x + (N[0, 1] * y + N[0, 2]))
    dv = 2 / view.fy * (N[0, 1] * x + (N[1, 1] * y + N[1, 2]))
    slope = np.sqrt(du * du + dv * dv)
    share = disc / np.maximum(slope, 1e-12) + 0.5
    return np.asarray(np.clip(share, 0.0, 1.0), np.float32)


def _weighed(sphere: list[FloatArray], weights: Float64Array) -> FloatArray:
    a, b, c = weights.tolist()
    return np.asarray(a * sphere[0] + b * sphere[1] + c * sphere[2])


def _window(outline: Silhouette, view: View) -> tuple[int, int, int, int] | None:
    x0, y0, x1, y1 = np.clip(outline.bounds, -100.0, 100.0).tolist()
    return view.window(
        view.fx * x0 + view.cx,
        view.fy * y0 + view.cy,
        view.fx * x1 + view.cx,
        view.fy * y1 + view.cy,
    )
