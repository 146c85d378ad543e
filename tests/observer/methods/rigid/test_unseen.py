"""Regions in which motion is undetectable: pairs with known plain, dark and near regions."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from observer.methods.rigid.dense.scene import DenseVision
from observer.methods.rigid.position_velocity_filter import PositionVelocityFilter
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.methods.rigid.unseen import UnseenRegions
from observer.parameters import StereoParameters
from observer.types import Image, Unseen
from observer.vision.view import View

from ...builders import Texture, as_image
from .solid_worlds import CAMERA, MOUNT, step_to

P = StereoParameters()
SHAPE = (CAMERA.height, CAMERA.width)
WALL, PERSON = Texture(1, SHAPE, finest_px=12.0), Texture(2, SHAPE, finest_px=12.0)
CELL_PX = 16
# Pixels of a patch of whole cells, as large as a person nearby, and its cells that are far enough
# from the texture around it.
PATCH = (slice(64, 320), slice(240, 432))
INSIDE = (slice(5, 19), slice(17, 25))
Paint = Callable[[Image, Image], None]
Box = tuple[float, float, float, float]


def nothing(left: Image, right: Image) -> None:
    """The textured wall alone."""


def flat(level: float) -> Paint:
    """A patch on the wall with one tone and the camera's noise."""

    def paint(left: Image, right: Image) -> None:
        noise = np.random.default_rng(5)
        for image in (left, right):
            tone = noise.normal(level, 1.0, SHAPE).clip(0, 255)
            image[PATCH] = tone.astype(np.uint8)[PATCH]

    return paint


def person_before_wall(disparity: int, part: tuple[slice, slice] = PATCH) -> Paint:
    """Somebody in patterned clothes in front of the wall."""

    def paint(left: Image, right: Image) -> None:
        rows, columns = part
        thing = as_image(PERSON.moved(), 1.0, 7)
        left[part] = thing[part]
        right[rows, columns.start - disparity : columns.stop - disparity] = thing[part]

    return paint


def plain_person_before_wall(disparity: int, level: int = 230) -> Paint:
    """Somebody in clothes of one tone in front of the wall."""

    def paint(left: Image, right: Image) -> None:
        rows, columns = PATCH
        left[PATCH] = level
        right[rows, columns.start - disparity : columns.stop - disparity] = level

    return paint


def view(index: int, paint: Paint, disparity: float = 10.0) -> View:
    """A textured wall at 6 m, with ``paint`` applied on or in front of it."""
    left = as_image(WALL.moved(), 1.0, 3 * index)
    right = as_image(WALL.moved(-disparity), 1.0, 3 * index + 1)
    paint(left, right)
    return View(index, 0.4 * index, None, left, right)


def unseen_in(*paints: Paint, boxes: Sequence[Box] = ()) -> Unseen:
    """The result for the last of several views, 0.4 s apart, from a static camera."""
    vision, regions = DenseVision(CAMERA, MOUNT), UnseenRegions(CAMERA)
    for index, paint in enumerate(paints):
        now = view(index, paint)
        scene = vision.look(now, step_to(dt=0.4), P, 0.0)
    return regions.look(now, scene, TrackedPoints.none(), boxes, (), P)


def letters(unseen: Unseen) -> np.ndarray:
    """(rows, columns) its cells."""
    return np.array([list(row) for row in unseen.rows])


def test_everything_on_a_textured_wall_is_seen() -> None:
    unseen = unseen_in(nothing, nothing)
    assert unseen.cell_px == CELL_PX
    assert letters(unseen).shape == (25, 40)
    assert unseen.share < 0.03
    assert not unseen.hides_person
    assert unseen.reasons == ()


@pytest.mark.parametrize(("level", "cause"), [(120, "plain"), (6, "dark"), (255, "dark")])
def test_a_patch_without_texture_is_marked_unseen_at_its_position(level: float, cause: str) -> None:
    unseen = unseen_in(flat(level), flat(level))
    cells = letters(unseen)
    assert (cells[INSIDE] == cause[0]).mean() > 0.95
    outside = cells.copy()
    outside[4:20, 15:27] = "."
    assert (outside == ".").mean() > 0.97
    assert unseen.share == pytest.approx(np.mean(cells != "."))
    assert unseen.causes[cause] == pytest.approx(np.mean(cells == cause[0]))
    assert sum(unseen.causes.values()) == pytest.approx(unseen.share)
    assert unseen.cause_at((330.0, 200.0)) == cause
    assert unseen.cause_at((60.0, 60.0)) is None


def test_a_dark_part_of_a_static_wall_degrades_but_a_plain_one_does_not() -> None:
    """A person walking in front of the wall shows an outline; in the dark there is none."""
    assert not unseen_in(flat(120), flat(120)).hides_person
    dark = unseen_in(flat(6), flat(6))
    assert dark.hides_person
    (reason,) = dark.reasons
    assert reason.startswith("motion could not be detected in ")
    assert "too dark or saturated (" in reason


def test_a_small_dark_spot_cannot_hide_a_person() -> None:
    def spot(left: Image, right: Image) -> None:
        left[96:160, 240:336] = right[96:160, 230:326] = 3

    assert unseen_in(spot, spot).share > 0
    assert not unseen_in(spot, spot).hides_person


def test_only_an_unreported_mover_in_plain_clothes_degrades() -> None:
    """Its outline has just arrived; its middle is as plain as a wall."""
    mover = unseen_in(nothing, plain_person_before_wall(40))
    assert (letters(mover)[INSIDE] == "p").mean() > 0.6
    assert mover.hides_person
    rows, columns = PATCH
    box = (columns.start, rows.start, columns.stop, rows.stop)
    assert not unseen_in(nothing, plain_person_before_wall(40), boxes=[box]).hides_person
    elsewhere = (0.0, 0.0, 100.0, 200.0)
    assert unseen_in(nothing, plain_person_before_wall(40), boxes=[elsewhere]).hides_person


def test_a_view_without_any_texture_degrades() -> None:
    def blank(left: Image, right: Image) -> None:
        left[:] = right[:] = 120

    unseen = unseen_in(blank, blank)
    assert unseen.share == 1.0
    assert unseen.causes == {"plain": 1.0}
    assert unseen.hides_person


@pytest.mark.parametrize("disparity", [120, 150, 190])
def test_objects_nearer_than_the_stereo_range_are_marked_near(disparity: int) -> None:
    unseen = unseen_in(nothing, person_before_wall(disparity))
    cells = letters(unseen)[INSIDE]
    assert (cells == "n").mean() > 0.6
    assert unseen.hides_person
    assert "too close" in unseen.reasons[0]


def test_a_possible_unreported_mover_is_marked_tentative() -> None:
    unseen = seen_with(tentative=[(64.0, 64.0, 95.0, 95.0)])
    assert unseen.cause_at((70.0, 70.0)) == "tentative"
    assert unseen.cause_at((130.0, 70.0)) != "tentative"
    assert any("started to move" in reason for reason in unseen.reasons)
    assert unseen.share < 0.03


def test_a_reported_obstacle_is_not_marked_tentative() -> None:
    box = (320.0, 180.0, 351.0, 243.0)
    assert seen_with(tentative=[box], reported=[box]).reasons == ()


def test_boxes_may_extend_beyond_the_image() -> None:
    unseen = seen_with(tentative=[(-50.0, -50.0, 20.0, 2000.0)])
    assert unseen.cause_at((0.0, 0.0)) == unseen.cause_at((0.0, 399.0)) == "tentative"
    assert not seen_with(tentative=[(-50.0, 20.0, -10.0, 80.0)]).reasons


def seen_with(*, tentative: Sequence[Box] = (), reported: Sequence[Box] = ()) -> Unseen:
    """The result for the fully visible textured wall with obstacles in these boxes."""
    now = view(0, nothing)
    scene = DenseVision(CAMERA, MOUNT).look(now, step_to(dt=0.4), P, 0.0)
    return UnseenRegions(CAMERA).look(now, scene, TrackedPoints.none(), reported, tentative, P)


def test_cells_without_points_are_unseen_at_speed() -> None:
    regions = UnseenRegions(CAMERA)
    now = view(0, nothing)
    unseen = regions.look(now, None, TrackedPoints.none(), (), (), P)
    assert unseen.causes["fast"] > 0.97
    assert unseen.hides_person


@pytest.mark.parametrize(("sightings", "depth", "sees"), [(5, 10.0, True), (1, 10.0, False),
                                                          (5, np.nan, False)])  # fmt: skip
def test_a_cell_is_seen_through_a_tracked_point_with_depth(
    sightings: int, depth: float, sees: bool
) -> None:
    px = np.array([[100.0, 50.0], [330.0, 200.0]], np.float32)
    disparity = np.full(2, depth)
    place = CAMERA.triangulate(px, np.full(2, 10.0))
    sums = PositionVelocityFilter.begin(place, np.broadcast_to(np.eye(3), (2, 3, 3)).copy())
    points = TrackedPoints.begin(0, px, px - np.float32(10), disparity, sums)
    points = points.but(sightings=np.full(2, sightings), cornered=np.ones(2, np.bool_))
    unseen = UnseenRegions(CAMERA).look(view(0, nothing), None, points, (), (), P)
    seen_at = [unseen.cause_at((float(u), float(v))) is None for u, v in px]
    assert seen_at == [sees, sees]
    assert unseen.cause_at((200.0, 50.0)) == "fast"


def test_the_same_view_gives_an_identical_result() -> None:
    assert unseen_in(nothing, flat(120)) == unseen_in(nothing, flat(120))
