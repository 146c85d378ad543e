"""Room, posters, boxes and P3-DX of the lab, built of convex parts."""

from __future__ import annotations

import math

import numpy as np

from observer.geometry import Float64Array
from observer.simulation.facets import (
    Facet,
    Material,
    Part,
    box_outline,
    prism,
    rectangle,
    wheel,
)
from observer.simulation.painting.canvas import Colour
from observer.simulation.specs.places import (
    BoxSpec,
    DoorSpec,
    PosterSpec,
    RoomSpec,
    StandingSpec,
    TableSpec,
    TextureSpec,
)
from observer.simulation.specs.vehicles import P3DX_SIZE

# Metres: a picture's gap to its wall, so that the depth comparison is unambiguous.
_POSTER_GAP_M = 0.004
# Strength of the shadow under a table; it is light, as light reaches it from all sides.
_TABLE_SHADOW = 0.3
# Tones (blue, green, red): table tops (beech, white, grey), legs, painted doors and frames.
_TABLE_TONES = ((132.0, 182.0, 212.0), (222.0, 226.0, 226.0), (156.0, 158.0, 158.0))
_LEG_TONES = ((70.0, 72.0, 74.0), (182.0, 184.0, 184.0), (40.0, 42.0, 44.0))
_LEAF_TONES = ((206.0, 212.0, 214.0), (120.0, 166.0, 198.0), (160.0, 140.0, 112.0))
_FRAME_TONES = ((92.0, 96.0, 100.0), (62.0, 80.0, 104.0), (74.0, 62.0, 54.0))
# Metres, of a table: slab thickness, leg thickness, and distance from its edge to a leg.
_SLAB_M, _LEG_M, _INSET_M = 0.03, 0.05, 0.04
WALLS = ("front", "left", "back", "right")


def wall_frame(room: RoomSpec, wall: str) -> tuple[Float64Array, Float64Array, float]:
    """Return upper left corner (3,), direction to the right (3,) and length of a wall from inside.

    Room frame, metres.
    """
    (x0, x1), (y0, y1), h = room.x, room.y, room.height_m
    corners = {"front": (x1, y1), "right": (x1, y0), "back": (x0, y0), "left": (x0, y1)}
    along = {"front": (0, -1), "right": (-1, 0), "back": (0, 1), "left": (1, 0)}
    length = y1 - y0 if wall in ("front", "back") else x1 - x0
    return np.array([*corners[wall], h]), np.array([*along[wall], 0.0]), length


def room_part(room: RoomSpec, texture: TextureSpec, seed: int) -> Part:
    """Build the room seen from inside: four walls, ceiling, floor, drawn in this order."""
    down = np.array([0.0, 0.0, -1.0])
    facets: list[Facet] = []
    for k, wall in enumerate(WALLS):
        origin, along, length = wall_frame(room, wall)
        material = _surface(f"wall_{room.walls}", seed + k, texture, wall)
        # WALLS is ordered to the left: the next wall adjoins this one's left edge.
        neighbours = ((k + 1) % 4, 5, (k - 1) % 4, 4)
        facets.append(rectangle(origin, along, down, (length, room.height_m), material, neighbours))
    (x0, x1), (y0, y1), h = room.x, room.y, room.height_m
    left, back, extent = np.array([0.0, -1.0, 0.0]), np.array([-1.0, 0.0, 0.0]), (y1 - y0, x1 - x0)
    floor = _surface(f"floor_{room.floor}", seed + 9, texture, "floor")
    facets += [
        rectangle([x0, y1, h], left, -back, extent, Material("ceiling"), (1, 0, 3, 2)),
        rectangle([x1, y1, 0.0], left, back, extent, floor, (1, 2, 3, 0)),
    ]
    return Part(tuple(facets))


def _surface(kind: str, seed: int, texture: TextureSpec, where: str) -> Material:
    shares = ("contrast", texture.contrast), ("share_without", texture.share_without)
    return Material(kind, seed, (*shares, ("where", where)))


def hanging_facet(
    spec: DoorSpec | PosterSpec, room: RoomSpec, texture: TextureSpec, seed: int
) -> Facet:
    """Build a poster or a door a few millimetres in front of its wall, room frame."""
    corner, along, _ = wall_frame(room, spec.wall)
    down = np.array([0.0, 0.0, -1.0])
    inward = np.cross(down, along)
    axis = 1 if spec.wall in ("front", "back") else 0
    sign = along[axis]
    w, h = spec.size
    to_centre = (spec.along_m - corner[axis]) * sign
    origin = (
        corner
        + (to_centre - w / 2) * along
        + (room.height_m - spec.height_m - h / 2) * down
        + _POSTER_GAP_M * inward
    )
    contrast = ("contrast", texture.contrast)
    if isinstance(spec, DoorSpec):
        leaf, frame = _tone(_LEAF_TONES, seed), _tone(_FRAME_TONES, seed)
        material = Material("door", 0, (contrast, *_colour(leaf), *_colour(frame, "2")))
    else:
        material = Material(f"poster_{spec.design}", seed, (contrast,))
    return rectangle(origin, along, down, (w, h), material)


def _tone(tones: tuple[Colour, ...], seed: int) -> Colour:
    """Pick a tone by a seed."""
    return tones[int(np.random.default_rng(seed).integers(len(tones)))]


def _colour(colour: Colour, which: str = "") -> tuple[tuple[str, float], ...]:
    """Return the options that give a material its colour."""
    return tuple((f"{name}{which}", value) for name, value in zip("bgr", colour, strict=True))


def standing_parts(spec: BoxSpec | TableSpec, texture: TextureSpec, seed: int) -> tuple[Part, ...]:
    """Build a box or a table in its own frame."""
    return (
        table_parts(spec, seed) if isinstance(spec, TableSpec) else box_parts(spec, texture, seed)
    )


def table_parts(spec: TableSpec, seed: int) -> tuple[Part, ...]:
    """Build a table's slab and its four legs; the slab's underside is shaded."""
    length, width, height = spec.size
    tone = b, g, r = _tone(_TABLE_TONES, seed)
    top, below, leg = (
        Material("flat", 0, _colour(colour))
        for colour in (tone, (0.55 * b, 0.55 * g, 0.55 * r), _tone(_LEG_TONES, seed + 1))
    )
    lower, upper = spec.above_m, spec.above_m + height
    slab = prism(box_outline(length, width), upper - _SLAB_M, upper, top, top, below)
    x, y = (side / 2 - _INSET_M - _LEG_M / 2 for side in (length, width))
    outline = box_outline(_LEG_M, _LEG_M)
    legs = (
        prism(outline + np.array([sx * x, sy * y]), lower, upper - _SLAB_M, leg, leg)
        for sx in (-1, 1)
        for sy in (-1, 1)
    )
    return (slab, *legs)


def box_parts(spec: BoxSpec, texture: TextureSpec, seed: int) -> tuple[Part, ...]:
    """Build a crate, cardboard box or cabinet in its own frame."""
    length, width, height = spec.size
    options = (
        ("contrast", texture.contrast),
        ("share_without", texture.share_without),
        ("length", length),
        ("width", width),
    )
    side, top = (Material(f"{spec.kind}_{face}", seed, options) for face in ("side", "top"))
    outline = box_outline(length, width)
    return (prism(outline, spec.above_m, spec.above_m + height, side, top),)


def p3dx_parts(
    size: tuple[float, float, float], texture: TextureSpec, seed: int
) -> tuple[Part, ...]:
    """Build a P3-DX: red body with a sonar ring, black deck and wheels, a payload if taller.

    The proportions are the real robot's, scaled to ``size`` (length, width, height).
    """
    length, width, height = size
    kx, ky = length / P3DX_SIZE[0], width / P3DX_SIZE[1]
    deck = min(height, P3DX_SIZE[2])
    kz = deck / P3DX_SIZE[2]
    dark = texture.robot == "dark"
    options = (
        ("contrast", texture.contrast),
        ("length", length),
        ("width", width * 0.76),
        ("chamfer", 0.075 * ky),
    )
    kind = "dark_robot" if dark else "p3dx"
    radius, breadth = 0.0975 * kz, 0.045 * ky
    parts = [
        prism(
            box_outline(length, width * 0.76, 0.075 * min(kx, ky)),
            0.045 * kz,
            deck,
            Material(f"{kind}_side", seed, options),
            Material(f"{kind}_deck", seed, options),
        )
    ]
    contrast = (("contrast", texture.contrast),)
    tread = Material("rubber", seed, contrast)
    disc = Material("wheel_dark" if dark else "wheel_disc", seed, contrast)
    for left in (True, False):
        y = (width - breadth) / 2 * (1 if left else -1)
        parts.append(wheel([0.03 * kx, y, radius], radius, breadth, left, disc, tread))
    payload = height - deck
    if payload > 0.005:
        angles = 2 * math.pi * np.arange(8) / 8
        outline = np.column_stack([np.cos(angles), np.sin(angles)]) * 0.085 * min(kx, ky)
        kind = "dark_robot" if dark else "scanner"
        side, lid = (Material(f"{kind}_{face}", seed, options) for face in ("payload", "lid"))
        parts.append(prism(outline + np.array([0.06 * kx, 0.0]), deck, height, side, lid))
    return tuple(parts)


def standing_shadow(spec: StandingSpec) -> Facet | None:
    """Build an object's shadow; a table's is lighter, objects above the floor have none."""
    if spec.above_m:
        return None
    light = (("depth", _TABLE_SHADOW),) if isinstance(spec, TableSpec) else ()
    return shadow_facet(spec.size[0], spec.size[1], light)


def shadow_facet(length: float, width: float, options: tuple[tuple[str, float], ...] = ()) -> Facet:
    """Build the soft contact shadow below a body, on the floor of the body's frame."""
    margin = 0.10
    origin = [length / 2 + margin, width / 2 + margin, 0.0]
    extent = (width + 2 * margin, length + 2 * margin)
    material = Material("shadow", 0, (("margin", margin), *options))
    return rectangle(origin, [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], extent, material)
