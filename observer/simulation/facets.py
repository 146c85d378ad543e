"""Planar convex facets, and the convex parts that bodies are built of.

A part is given in its body's frame: x along the heading, y left, z up, metres, the origin on the
floor below the body's centre; room surfaces are given in the room frame. A facet is visible from
the side its normal points to; its vertices run counter-clockwise as seen from there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from observer.geometry import Float64Array, Pose


@dataclass(frozen=True)
class Material:
    """A painter's name, its options, and the seed of its randomness.

    Equal materials of equal extent look equal, so their texture is painted once.

    Attributes:
        kind: the painter's name.
        seed: of the texture.
        options: names and values that the painter understands.
    """

    kind: str
    seed: int = 0
    options: tuple[tuple[str, float | str], ...] = ()

    def number(self, name: str, default: float) -> float:
        return float(dict(self.options).get(name, default))

    def text(self, name: str, default: str) -> str:
        return str(dict(self.options).get(name, default))


@dataclass(frozen=True, eq=False)
class Facet:
    """A planar convex polygon with a texture.

    Attributes:
        vertices: (N, 3) metres.
        origin: (3,) position of the texture's upper left corner, metres.
        along, down: (3,) unit vectors of the texture's columns and rows.
        extent: size of the texture along and down, metres.
        neighbours: for each edge (vertex k to k + 1) the index, within the part, of the facet
            that shares the edge, or None; used to draw adjoining facets without a seam.
    """

    vertices: Float64Array
    origin: Float64Array
    along: Float64Array
    down: Float64Array
    extent: tuple[float, float]
    material: Material
    neighbours: tuple[int | None, ...]

    @cached_property
    def normal(self) -> Float64Array:
        """(3,) outward unit vector: down x along, as rows run down and columns right."""
        return np.asarray(np.cross(self.down, self.along), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Part:
    """A convex solid, or a room seen from inside, made of facets.

    Attributes:
        facets: in the order in which they are drawn.
    """

    facets: tuple[Facet, ...]

    @cached_property
    def sphere(self) -> tuple[Float64Array, float]:
        """Centre (3,) and radius of a sphere around all vertices, metres."""
        return sphere_around(np.concatenate([f.vertices for f in self.facets]))

    @cached_property
    def _planes(self) -> tuple[Float64Array, Float64Array]:
        """Normals (F, 3) and their distances (F,) from the origin, metres."""
        offsets = np.array([f.normal @ f.origin for f in self.facets])
        return np.array([f.normal for f in self.facets]), offsets

    def facing(self, eye: Float64Array) -> Float64Array:
        """Return (F,) signed distances, metres, of ``eye`` (3,), part frame, in front of facets."""
        normals, offsets = self._planes
        return np.asarray(normals @ eye - offsets, dtype=np.float64)


def sphere_around(vertices: Float64Array) -> tuple[Float64Array, float]:
    """Return centre (3,) and radius of a sphere around vertices (N, 3), metres."""
    centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    return centre, float(np.linalg.norm(vertices - centre, axis=1).max())


def moved(part: Part, pose: Pose) -> Part:
    """Return the part in another frame; ``pose`` is ``T_target_part``."""
    return Part(
        tuple(
            replace(
                f,
                vertices=pose.apply(f.vertices),
                origin=pose.apply(f.origin),
                along=pose.rotate(f.along),
                down=pose.rotate(f.down),
            )
            for f in part.facets
        )
    )


def rectangle(
    origin: ArrayLike,
    along: ArrayLike,
    down: ArrayLike,
    extent: tuple[float, float],
    material: Material,
    neighbours: tuple[int | None, int | None, int | None, int | None] = (None, None, None, None),
) -> Facet:
    """Build a rectangle filled by its texture; edges in the order left, bottom, right, top."""
    o = np.asarray(origin, dtype=np.float64)
    a = np.asarray(along, dtype=np.float64)
    d = np.asarray(down, dtype=np.float64)
    w, h = extent
    vertices = np.array([o, o + h * d, o + h * d + w * a, o + w * a])
    return Facet(vertices, o, a, d, extent, material, neighbours)


_UP = np.array([0.0, 0.0, 1.0])


def prism(
    outline: ArrayLike,
    bottom: float,
    top: float,
    sides: Material,
    lid: Material,
    underside: Material | None = None,
) -> Part:
    """Build an upright prism.

    Args:
        outline: (N, 2) convex, counter-clockwise as seen from above, metres.
        bottom, top: heights, metres.
        sides: one texture around the whole outline, from its first vertex on.
        lid: texture of the upper face; the texture's rows run backwards along -x.
        underside: its rows run forwards along x; None for a part that stands on the floor.
    """
    points = np.asarray(outline, dtype=np.float64)
    n = len(points)
    edges = np.roll(points, -1, axis=0) - points
    lengths = np.linalg.norm(edges, axis=1)
    starts = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
    girth = float(lengths.sum())
    facets = []
    for k in range(n):
        a = points[k]
        b = points[(k + 1) % n]
        along = np.array([*(edges[k] / lengths[k]), 0.0])
        vertices = np.array([[*a, top], [*a, bottom], [*b, bottom], [*b, top]])
        origin = np.array([*a, top]) - starts[k] * along
        neighbours = ((k - 1) % n, None if underside is None else n + 1, (k + 1) % n, n)
        facets.append(
            Facet(vertices, origin, along, -_UP, (girth, top - bottom), sides, neighbours)
        )
    facets.append(_lid(points, top, lid))
    if underside is not None:
        facets.append(_underside(points, bottom, underside))
    return Part(tuple(facets))


def _lid(points: Float64Array, height: float, material: Material) -> Facet:
    low, high = points.min(axis=0), points.max(axis=0)
    vertices = np.column_stack([points, np.full(len(points), height)])
    return Facet(
        vertices,
        np.array([high[0], high[1], height]),
        np.array([0.0, -1.0, 0.0]),
        np.array([-1.0, 0.0, 0.0]),
        (float(high[1] - low[1]), float(high[0] - low[0])),
        material,
        tuple(range(len(points))),
    )


def _underside(points: Float64Array, height: float, material: Material) -> Facet:
    low, high = points.min(axis=0), points.max(axis=0)
    n = len(points)
    return Facet(
        np.column_stack([points[::-1], np.full(n, height)]),
        np.array([low[0], high[1], height]),
        np.array([0.0, -1.0, 0.0]),
        np.array([1.0, 0.0, 0.0]),
        (float(high[1] - low[1]), float(high[0] - low[0])),
        material,
        # Edge k of the reversed outline belongs to the side that starts at its second vertex.
        tuple((n - 2 - k) % n for k in range(n)),
    )


def box_outline(length: float, width: float, chamfer: float = 0.0) -> Float64Array:
    """Return (4, 2) or, with cut corners, (8, 2): a rectangle about the origin, counter-clockwise.

    The first edge is the right side, from back to front.
    """
    x, y, c = length / 2, width / 2, chamfer
    if c <= 0:
        return np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
    right_and_front = [[-x + c, -y], [x - c, -y], [x, -y + c], [x, y - c]]
    return np.array([*right_and_front, [x - c, y], [-x + c, y], [-x, y - c], [-x, -y + c]])


def wheel(
    centre: ArrayLike, radius: float, width: float, left: bool, disc: Material, tread: Material
) -> Part:
    """Build a wheel along x: its outer disc and the visible tread; the inner disc is hidden.

    Args:
        centre: (3,) of the wheel, metres. left: True if the outer disc faces left.
    """
    c = np.asarray(centre, dtype=np.float64)
    sign = 1.0 if left else -1.0
    n = 14
    angles = 2 * math.pi * np.arange(n) / n
    outer = c + np.array([0.0, sign * width / 2, 0.0])
    inner = c - np.array([0.0, sign * width / 2, 0.0])
    spokes = np.column_stack([np.cos(angles), np.zeros(n), np.sin(angles)]) * radius
    # Seen from the left (+y), counter-clockwise is from z to x; from the right it is x to z.
    order = np.arange(n)[::-1] if left else np.arange(n)
    along = np.array([-sign, 0.0, 0.0])
    origin = outer - radius * along + radius * _UP
    size = (2 * radius, 2 * radius)
    facets = [Facet(outer + spokes[order], origin, along, -_UP, size, disc, (None,) * n)]
    # Only the front and rear quarters of the tread, below the mudguard, are visible.
    for k in range(n):
        a, b = spokes[k], spokes[(k + 1) % n]
        if abs(a[2] + b[2]) > 1.3 * radius:
            continue
        right, lft = (inner, outer) if left else (outer, inner)
        down = (b - a) / np.linalg.norm(b - a)
        across = np.array([0.0, -1.0, 0.0])
        vertices = np.array([lft + a, lft + b, right + b, right + a])
        extent = (width, float(np.linalg.norm(b - a)))
        facet = Facet(vertices, lft + a, across, down, extent, tread, (None,) * 4)
        if facet.normal @ (a + b) < 0:
            vertices = np.array([lft + b, lft + a, right + a, right + b])
            facet = Facet(vertices, lft + b, across, -down, extent, tread, (None,) * 4)
        facets.append(facet)
    return Part(tuple(facets))
