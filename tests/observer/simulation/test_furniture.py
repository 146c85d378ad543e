"""Tables, doors and bare walls: long straight edges between flat tones."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from observer.simulation.bodies import table_parts
from observer.simulation.imaging import LEFT, StereoImager
from observer.simulation.scenarios import load_scenario, scenario_from_text
from observer.simulation.specs.places import TableSpec
from observer.simulation.visibility import ROOM
from observer.simulation.world import World

from .pixel_truth import left_hits, left_rays, render_depth

SCENE = """
title: Furniture
help: A table before a door in a bare room.
declares: ideal
duration_s: 10
camera: {tilt_deg: 0}
room: {x: [-2, 4], y: [-2.5, 2.5], height_m: 2.6, walls: bare}
objects:
  - {kind: door, wall: front, along_m: 0.9}
  - {kind: table, x: 2.6, y: -0.4, heading_deg: 3}
variation: {position_m: 0.15, heading_deg: 5}
"""


def world(seed: int = 0) -> World:
    return World(scenario_from_text(SCENE, "furniture"), seed)


def core(mask: np.ndarray) -> np.ndarray:
    return cv2.erode(mask.astype(np.uint8), np.ones((5, 5))) > 0


def test_a_table_is_a_closed_slab_on_four_legs() -> None:
    spec = TableSpec(kind="table", x=0, y=0, size=(0.7, 1.4, 0.74))
    slab, *legs = table_parts(spec, seed=1)
    assert len(legs) == 4
    for k, facet in enumerate(slab.facets):
        edges = zip(facet.vertices, np.roll(facet.vertices, -1, axis=0), strict=True)
        for (a, b), neighbour in zip(edges, facet.neighbours, strict=True):
            assert neighbour is not None
            other = slab.facets[neighbour]
            ends = zip(other.vertices, np.roll(other.vertices, -1, axis=0), strict=True)
            back = [
                n for (c, d), n in zip(ends, other.neighbours, strict=True)
                if np.allclose(a, d) and np.allclose(b, c)
            ]  # fmt: skip
            assert back == [k]
        # The normal points outward on every side.
        assert facet.normal @ (facet.vertices.mean(axis=0) - slab.sphere[0]) > 0
    for leg in legs:
        heights = np.concatenate([facet.vertices for facet in leg.facets])[:, 2]
        assert heights.min() == 0
        assert heights.max() == pytest.approx(0.71)


def test_a_table_has_flat_tones_and_shows_the_room_between_its_legs() -> None:
    scene = world()
    image = StereoImager(scene).clean(LEFT, 0.0)
    table = left_hits(scene, 0.0).body == scene.bodies[0].id
    _, counts = np.unique(image[core(table)], axis=0, return_counts=True)
    # Slab and legs from one or two sides, and the underside; the rest are their borders.
    assert np.sort(counts)[-8:].sum() > 0.9 * counts.sum()
    rows, columns = np.nonzero(table)
    window = np.s_[rows.min() : rows.max(), columns.min() : columns.max()]
    assert 0.1 < table[window].mean() < 0.6
    # The camera is below the underside, which rises away from the horizon.
    depth = render_depth(scene, 0.0)
    underside = np.isclose(0.4 - left_rays(scene)[..., 1] * depth, 0.71, atol=1e-6) & table
    assert underside.sum() > 300
    assert len(np.unique(image[core(underside)], axis=0)) == 1


def test_a_door_is_a_flat_leaf_in_a_frame_down_to_the_floor() -> None:
    scene = world()
    (door,) = scene.posters
    assert door.vertices[:, 2].min() == pytest.approx(0.0)
    assert door.vertices[:, 1].mean() == pytest.approx(0.9)
    image = StereoImager(scene).clean(LEFT, 0.0).astype(int)
    f = scene.true_calibration.K1[0, 0]

    def at(y: float, z: float) -> np.ndarray:
        x = 4 - 0.05
        u, v = 255.5 - f * (y - 0.06) / x, 127.5 - f * (z - 0.4) / x
        return image[round(v), round(u)]

    leaf, frame, wall = at(1.0, 0.6), at(1.37, 0.6), at(1.6, 0.6)
    assert np.abs(at(0.7, 1.2) - leaf).max() <= 1
    assert np.abs(at(0.43, 1.2) - frame).max() <= 1
    assert np.abs(leaf - frame).max() > 20
    assert np.abs(frame - wall).max() > 20


def test_bare_walls_have_no_texture_and_end_at_a_ceiling_of_another_tone() -> None:
    scenario = load_scenario("static_edges_turning")
    upwards = scenario.camera.model_copy(update={"tilt_deg": -4.0})
    scene = World(scenario.model_copy(update={"camera": upwards}))
    gray = cv2.cvtColor(StereoImager(scene).clean(LEFT, 0.0), cv2.COLOR_BGR2GRAY).astype(float)
    hits, rays = left_hits(scene, 0.0), left_rays(scene)
    points = np.concatenate([rays, np.ones((*rays.shape[:-1], 1))], axis=-1)
    points = scene.T_room_left(0.0).apply(points / hits.inverse_depth[..., None])
    room = hits.body == ROOM
    above = room & (points[..., 2] > 2.2)
    wall, ceiling = above & (points[..., 2] < 2.55), above & (points[..., 2] > 2.6 - 1e-6)
    assert core(wall).sum() > 500
    assert ceiling.sum() > 3000
    # Within a wall only the lighting varies.
    assert np.percentile(np.abs(np.diff(gray, axis=1))[core(wall)[:, 1:]], 95) <= 2
    edge = ceiling[:-4] & wall[4:]
    assert edge.any(axis=0).mean() > 0.3
    assert np.median(gray[:-4][edge] - gray[4:][edge]) > 8


def test_a_seed_moves_the_furniture_and_chooses_its_tones() -> None:
    places = {(w.bodies[0].T_room_body(0.0).translation[0], w.posters[0].origin[1])
              for w in map(world, range(6))}  # fmt: skip
    assert len(places) == 6
    assert (2.6, 0.9 + 0.5) in {(round(x, 6), round(y, 6)) for x, y in places}
    for facets in (
        {w.bodies[0].parts[0].facets[0].material for w in map(world, range(6))},
        {w.posters[0].material for w in map(world, range(6))},
    ):
        assert len(facets) > 1
    assert world(3).scenario == world(3).scenario
