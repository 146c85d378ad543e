"""Convex outlines on a floor, seen from above, and their collisions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from observer.geometry import Float64Array
from observer.simulation.motion import PlanarState

Point = tuple[float, float]


@dataclass(frozen=True)
class Outline:
    """A convex polygon on the floor, corners counter-clockwise, metres."""

    corners: tuple[Point, ...]

    @staticmethod
    def of_box(x: float, y: float, heading: float, length: float, width: float) -> Outline:
        """Return the outline of a box centred at ``x``, ``y``, its length along ``heading``."""
        c, s = math.cos(heading), math.sin(heading)
        a, b = length / 2, width / 2
        around = ((a, b), (-a, b), (-a, -b), (a, -b))
        return Outline(tuple((x + c * u - s * v, y + s * u + c * v) for u, v in around))

    @cached_property
    def circle(self) -> tuple[float, float, float]:
        """Enclosing circle about the mean of the corners: x, y and radius."""
        n = len(self.corners)
        x, y = sum(x for x, _ in self.corners) / n, sum(y for _, y in self.corners) / n
        return x, y, max(math.hypot(u - x, v - y) for u, v in self.corners)

    def depth(self, other: Outline) -> float:
        """Return the penetration depth of two outlines, metres; 0 where they do not overlap.

        It is the smallest translation that separates them along one of the candidate separating
        axes, the normals of both outlines' edges (Gottschalk, Lin and Manocha, "OBBTree", 1996).
        """
        least = math.inf
        for one in (self.corners, other.corners):
            for k, (ax, ay) in enumerate(one):
                bx, by = one[k - 1]
                length = math.hypot(bx - ax, by - ay)
                nx, ny = (by - ay) / length, (ax - bx) / length
                mine = [nx * x + ny * y for x, y in self.corners]
                theirs = [nx * x + ny * y for x, y in other.corners]
                overlap = min(max(mine) - min(theirs), max(theirs) - min(mine))
                if overlap <= 0:
                    return 0.0
                least = min(least, overlap)
        return least


@dataclass(frozen=True)
class Surroundings:
    """Obstacles to one vehicle.

    Attributes:
        room: lowest and highest x, lowest and highest y of the walls; None for an endless floor.
        outlines: everything else at this instant.
    """

    room: tuple[float, float, float, float] | None = None
    outlines: tuple[Outline, ...] = ()

    def depth(self, outline: Outline) -> float:
        """Return the largest penetration depth of an outline, metres; 0 without contact."""
        worst = 0.0
        if self.room is not None:
            x0, x1, y0, y1 = self.room
            for x, y in outline.corners:
                worst = max(worst, x0 - x, x - x1, y0 - y, y - y1)
        x, y, radius = outline.circle
        for other in self.outlines:
            u, v, far = other.circle
            if math.hypot(u - x, v - y) < far + radius:
                worst = max(worst, outline.depth(other))
        return worst

    def edges(self) -> Float64Array:
        """Return (N, 4) float64: x, y of both ends of every edge, walls included."""
        edges: list[tuple[float, float, float, float]] = []
        polygons: list[Sequence[Point]] = [outline.corners for outline in self.outlines]
        if self.room is not None:
            x0, x1, y0, y1 = self.room
            polygons.append(((x0, y0), (x1, y0), (x1, y1), (x0, y1)))
        for corners in polygons:
            edges += [(*corners[k - 1], *corners[k]) for k in range(len(corners))]
        return np.array(edges, dtype=np.float64).reshape(-1, 4)


def outline_at(state: PlanarState, length: float, width: float) -> Outline:
    """Return the outline of a vehicle in a state."""
    return Outline.of_box(state.x, state.y, state.heading, length, width)
