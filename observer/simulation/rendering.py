"""Renders the world: selects facets, their order and their brightness.

The room is convex and seen from inside, so no part of it hides another. Bodies are drawn from far
to near, and ``drawing`` resolves occlusion by depth. A board held before the cameras is drawn last;
if the camera stands still and nothing else moves, the rest is drawn only once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from observer.geometry import Pose
from observer.simulation.batches import FacetBatch, SeenFacet, View
from observer.simulation.drawing import NEAR_M, Drawing, Image
from observer.simulation.facets import Facet, Material, Part, moved
from observer.simulation.lighting import light
from observer.simulation.motion import Parked
from observer.simulation.people.drawing import PersonDrawing, SeenPerson
from observer.simulation.polygons import Float32Array
from observer.simulation.reflections import mirrored, reflectance
from observer.simulation.textures import Texture, paint
from observer.simulation.world import Body, World


class Renderer:
    """Renderer of one world; it caches the world's textures."""

    def __init__(self, world: World) -> None:
        room: list[Part] = [world.room, *(Part((poster,)) for poster in world.posters)]
        shadows: list[Part] = []
        standing: list[Part] = []
        moving: list[Body] = []
        self._people = tuple(
            PersonDrawing(body.person, body.T_room_body, self._paint)
            for body in world.bodies
            if body.person is not None
        )
        for body in world.bodies:
            if not isinstance(body.motion, Parked) or body.person is not None:
                moving.append(body)
                continue
            T_room_body = body.T_room_body(0.0)
            standing += [moved(part, T_room_body) for part in body.parts]
            if body.shadow is not None:
                shadows.append(moved(Part((body.shadow,)), T_room_body))
        # All static parts form one batch in the room's frame; each moving body has its own.
        self._standing = _Thing(lambda _: Pose.identity(), room, shadows, standing)
        self._moving = tuple(_moving_thing(body) for body in moving)
        # The last of the room's facets is its floor.
        self._floor = world.room.facets[-1]
        self._gloss = world.scenario.room.gloss
        self._board: _Thing | None = None
        if world.board is not None:
            self._board = _Thing(world.T_room_board, (), (), (world.board.part,))
        # Otherwise no two images share a background, and caching it would only cost time.
        self._keeps = self._board is not None and world.camera_is_static and not moving
        # What is behind the board: (H, W, 3) BGR of the drawn rows, and (H, W) 1/m.
        self._backgrounds: dict[tuple[View, bytes], tuple[Image, Float32Array]] = {}
        self._textures: dict[int, Texture] = {}
        self._painted: dict[tuple[Material, tuple[float, float]], Texture] = {}

    def draw(self, view: View, T_room_camera: Pose, time: float, image: Image) -> None:
        """Draw the view's rows at ``time`` into ``image`` (H, W, 3) BGR; every pixel is written.

        Moving bodies are drawn where they are at ``time``.
        """
        if self._board is None:
            self._draw_lab(Drawing(self.texture, view, image), view, T_room_camera, time)
            return
        drawing = self._background(view, T_room_camera, time, image)
        board = _SeenThing(self._board, view, T_room_camera, time)
        for facet, one, gain in board.facets(self._board.solids):
            drawing.facet(facet, one, gain, hides=True)

    def _background(self, view: View, T_room_camera: Pose, time: float, image: Image) -> Drawing:
        """Return the drawing of everything but the board, from the cache if unchanged."""
        rows = slice(*view.rows)
        key = (view, T_room_camera.matrix.tobytes())
        if key in self._backgrounds:
            image[rows], inverse_depth = self._backgrounds[key]
            return Drawing(self.texture, view, image, inverse_depth.copy())
        drawing = Drawing(self.texture, view, image)
        self._draw_lab(drawing, view, T_room_camera, time)
        if self._keeps:
            self._backgrounds[key] = image[rows].copy(), drawing.inverse_depth.copy()
        return drawing

    def _draw_lab(self, drawing: Drawing, view: View, T_room_camera: Pose, time: float) -> None:
        things = (self._standing, *self._moving)
        every = [_SeenThing(thing, view, T_room_camera, time) for thing in things]
        seen = [one for one in every if one.may_be_in_view]
        floor: SeenFacet | None = None
        for facet, part, _ in every[0].facets(self._standing.room):
            drawing.facet(facet, part, 1.0, hides=False)
            if facet is self._floor:
                floor = part
        for one in seen:
            for facet, part, _ in one.facets(one.thing.shadows):
                drawing.shadow(facet, part)
        if floor is not None and self._gloss:
            self._reflect(floor, drawing, T_room_camera, time)
        drawn: list[_SeenThing | SeenPerson] = [*seen]
        drawn += [person.seen(T_room_camera, time) for person in self._people]
        ordered = [(distance, one, k) for one in drawn for distance, k in one.solids()]
        for _, solid, k in sorted(ordered, key=lambda item: -item[0]):
            solid.draw(k, drawing)

    def _reflect(
        self, floor: SeenFacet, drawing: Drawing, T_room_camera: Pose, time: float
    ) -> None:
        """Draw what the floor reflects; a board held before the cameras is not reflected."""
        covered = drawing.cover(floor)
        if covered is None:
            return
        window, share = covered
        u0, v0, u1, v1 = window
        view, T_room_mirror = mirrored(drawing.view, T_room_camera, (v0, v1))
        image = np.ascontiguousarray(drawing.image[::-1])
        # The floor is invisible from below, so nothing is mirrored twice.
        self._draw_lab(Drawing(self.texture, view, image), view, T_room_mirror, time)
        share *= reflectance(drawing.view, window, T_room_camera.rotation, self._gloss)
        drawing.reflect(window, image[::-1][v0:v1, u0:u1], share)

    def texture(self, facet: Facet) -> Texture:
        """Return the texture of a facet, painted at its first use."""
        # Facets live as long as the world, so their id is a safe key.
        found = self._textures.get(id(facet))
        if found is None:
            found = self._textures[id(facet)] = self._paint(facet.material, facet.extent)
        return found

    def _paint(self, material: Material, extent: tuple[float, float]) -> Texture:
        key = (material, extent)
        if key not in self._painted:
            self._painted[key] = paint(material, extent)
        return self._painted[key]


class _Thing:
    """Parts that share one frame.

    Attributes:
        T_room: their frame's pose in the room at a time.
        room, shadows, solids: index ranges in ``parts``.
    """

    def __init__(
        self,
        T_room: Callable[[float], Pose],
        room: Sequence[Part],
        shadows: Sequence[Part],
        solids: Sequence[Part],
    ) -> None:
        self.T_room = T_room
        self.parts = (*room, *shadows, *solids)
        self.room = range(len(room))
        self.shadows = range(len(room), len(room) + len(shadows))
        self.solids = range(len(room) + len(shadows), len(self.parts))
        self.batch = FacetBatch(self.parts)


def _moving_thing(body: Body) -> _Thing:
    shadows = () if body.shadow is None else (Part((body.shadow,)),)
    return _Thing(body.T_room_body, (), shadows, body.parts)


class _SeenThing:
    """A thing as one camera sees it at one time."""

    def __init__(self, thing: _Thing, view: View, T_room_camera: Pose, time: float) -> None:
        R, eye = T_room_camera.rotation.T, T_room_camera.translation
        T_room_thing = thing.T_room(time)
        self.thing = thing
        # Rotates the thing's normals to the room's axes.
        self._R_room = T_room_thing.rotation
        # The camera centre in the thing's frame.
        self._eye = self._R_room.T @ (eye - T_room_thing.translation)
        R, t = R @ self._R_room, R @ (T_room_thing.translation - eye)
        # Facets of a thing outside the view are not computed at all.
        self.may_be_in_view = not thing.batch.outside(R, t, view)
        self._seen: list[SeenFacet | None] = []
        if self.may_be_in_view:
            self._seen = thing.batch.seen(R, t, self._eye, view, NEAR_M)

    def solids(self) -> Iterator[tuple[float, int]]:
        """Yield the squared distance from the eye, m^2, and the number of each solid part."""
        for k in self.thing.solids:
            to_eye = self.thing.parts[k].sphere[0] - self._eye
            yield float(to_eye @ to_eye), k

    def draw(self, part: int, drawing: Drawing) -> None:
        """Draw one solid part over everything farther away."""
        for facet, seen, gain in self.facets(range(part, part + 1)):
            drawing.facet(facet, seen, gain, hides=True)
        drawing.hide_behind()

    def facets(self, parts: range) -> Iterator[tuple[Facet, SeenFacet, float]]:
        """Yield the facets of some parts that may be in the image, with their brightness."""
        if not self.may_be_in_view:
            return
        for k in parts:
            first = self.thing.batch.starts[k]
            for index, facet in enumerate(self.thing.parts[k].facets):
                one = self._seen[first + index]
                if one is not None:
                    yield facet, one, float(light(self._R_room @ facet.normal))
