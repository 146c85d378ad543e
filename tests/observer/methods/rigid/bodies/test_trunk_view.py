"""Head and shoulders are found in a later image from all of their grey levels."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from observer.geometry import Float64Array
from observer.methods.rigid.bodies.trunk_view import TrunkView
from observer.methods.rigid.dense.segments import Segment, segment_of

from ..person_pictures import BOTTOM, HERE, LEFT, PERSON, TOP, Image, picture
from ..solid_worlds import GRID, ROOM, seen


def view_of(image: Image, segment: Segment = HERE) -> TrunkView:
    found = TrunkView.of(segment, replace(seen([*ROOM, PERSON]), left=image), 0.0)
    assert found is not None
    return found


def moved(
    before: Image, now: Image, expected: tuple[float, float] = (0.0, 0.0), reach: int = 4
) -> tuple[Float64Array, Float64Array]:
    """(2,) cells by which it moved, and the covariance."""
    view = view_of(before)
    found = view.found_in(now, view.middle + expected, view.middle, 1.0, reach)
    assert found is not None
    return found[0] - view.middle, found[1]


@pytest.mark.parametrize("shift", [(0.4, 0.0), (-1.7, 0.3), (3.6, -0.8)])
@pytest.mark.parametrize("wall", [0.0, 20.0])
def test_a_trunk_is_found_within_a_tenth_of_a_cell(shift: tuple[float, float], wall: float) -> None:
    found, cov = moved(picture(wall=wall), picture(shift, wall=wall, seed=1))
    np.testing.assert_allclose(found, shift, atol=0.1)
    assert np.sqrt(cov[0, 0]) < max(0.1, 1.1 * abs(shift[0]))


@pytest.mark.parametrize("shift", [(1.3, 0.0), (-2.4, 0.0)])
def test_a_trunk_in_plain_clothes_is_found_by_its_outline(shift: tuple[float, float]) -> None:
    found, _ = moved(picture(clothes=0.0), picture(shift, clothes=0.0, seed=1))
    assert found[0] == pytest.approx(shift[0], abs=0.35)


def test_changing_light_is_not_motion() -> None:
    found, _ = moved(picture(), picture((1.0, 0.0), light=15.0, seed=1))
    np.testing.assert_allclose(found, (1.0, 0.0), atol=0.1)


@pytest.mark.parametrize("swing", [-3.0, 3.0])
def test_an_arm_in_front_of_the_trunk_hardly_shifts_it(swing: float) -> None:
    found, _ = moved(picture(arm=4.0), picture((1.0, 0.0), arm=4.0 + swing, seed=1))
    np.testing.assert_allclose(found, (1.0, 0.0), atol=0.2)


def test_an_approaching_trunk_is_found_at_a_larger_scale() -> None:
    before = picture()
    view = view_of(before)
    about = np.array([[1.1, 0.0, -0.1 * view.middle[0]], [0.0, 1.1, -0.1 * view.middle[1]]])
    nearer = np.asarray(cv2.warpAffine(before, about, before.shape[::-1]), np.uint8)
    found = view.found_in(nearer, view.middle, view.middle, 1.1, 2)
    assert found is not None
    np.testing.assert_allclose(found[0], view.middle, atol=0.1)


def test_a_plain_surface_gives_no_shift() -> None:
    plain = [picture(clothes=0.0, tone=0.0, seed=seed) for seed in (0, 1)]
    found, cov = moved(plain[0], plain[1], expected=(1.5, 0.0), reach=8)
    assert abs(found[0] - 1.5) < 1.0, "nothing better than expected is invented"
    assert np.sqrt(cov[0, 0]) > 1.0


def test_a_possibly_static_trunk_is_within_one_deviation_of_rest() -> None:
    still = [picture(seed=seed) for seed in (0, 1)]
    found, cov = moved(still[0], still[1], expected=(0.7, 0.0))
    assert abs(found[0]) < 0.1
    pair = [picture(clothes=0.8, tone=0.0, seed=seed) for seed in (0, 1)]
    found, cov = moved(pair[0], pair[1], expected=(2.0, 0.0))
    assert np.sqrt(cov[0, 0]) >= 0.95 * abs(found[0])


def test_a_trunk_outside_the_image_is_not_found() -> None:
    view = view_of(picture())
    beyond = np.array([-60.0, view.middle[1]])
    assert view.found_in(picture(), beyond, view.middle, 1.0, 2) is None


def test_too_few_cells_give_no_view() -> None:
    scene = seen([*ROOM, PERSON])
    mask = np.zeros(GRID.shape, np.bool_)
    mask[TOP : TOP + 6, LEFT : LEFT + 3] = True
    assert TrunkView.of(segment_of(scene, mask), scene, 0.0) is None


def test_a_body_is_not_found_when_its_only_edge_left_the_image() -> None:
    before = np.full(GRID.shape, 128, np.uint8)
    before[TOP:BOTTOM, LEFT] = 255
    view = view_of(before)
    # Shifted so far that the edge is outside but most of the body is not.
    expected = view.middle - [LEFT + 3, 0]
    now = np.full(GRID.shape, 128, np.uint8)
    assert view.found_in(now, expected, view.middle, 1.0, 0) is None
