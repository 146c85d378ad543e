"""A segment's disparity by its grey levels does not cluster at whole cells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from observer.methods.rigid.bodies.outline import measured_anchor
from observer.methods.rigid.dense.fine_disparity import refined
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import Segment

from ..person_pictures import HERE, PERSON, Image, picture
from ..solid_worlds import GRID, ROOM, seen

RED = GRID.reduction


def pair(cells: float, *, clothes: float = 20.0, wall: float = 10.0) -> tuple[Image, Image]:
    """The images of a person with a disparity in cells."""
    left = picture(clothes=clothes, wall=wall)
    return left, picture((-cells, 0.0), clothes=clothes, wall=wall, seed=1)


def locked(images: tuple[Image, Image], cells: float) -> tuple[DenseScene, Segment]:
    """A scene and its person, whose cells have the nearest whole disparity."""
    left, right = images
    scene = replace(seen([*ROOM, PERSON]), left=left, right=right)
    return scene, replace(HERE, disparity=round(cells) * RED)


@pytest.mark.parametrize("cells", [9.7, 9.9, 10.0, 10.2, 10.4])
def test_it_is_free_of_pixel_locking(cells: float) -> None:
    scene, segment = locked(pair(cells), cells)
    fine = refined(segment, scene).fine
    assert fine == pytest.approx(cells * RED, abs=0.06 * RED)


@pytest.mark.parametrize("cells", [9.75, 10.25])
def test_the_outline_of_plain_clothes_tells_it(cells: float) -> None:
    scene, segment = locked(pair(cells, clothes=0.0, wall=0.0), cells)
    fine = refined(segment, scene).fine
    assert fine == pytest.approx(cells * RED, abs=0.12 * RED)


def test_a_correction_of_the_cells_is_kept() -> None:
    scene, segment = locked(pair(10.2), 10.0)
    corrected = replace(scene, disparity=scene.matched + np.float32(0.5))
    fine = refined(replace(segment, disparity=segment.disparity + 0.5), corrected).fine
    assert fine == pytest.approx(10.2 * RED + 0.5, abs=0.06 * RED)


def test_images_without_contrast_tell_nothing() -> None:
    grey = np.full(GRID.shape, 90, np.uint8)
    scene, segment = locked((grey, grey), 10.0)
    assert refined(segment, scene).fine is None
    assert refined(segment, scene).best_disparity == segment.disparity


def test_what_is_seen_at_another_disparity_is_another_surface() -> None:
    scene, segment = locked(pair(11.0), 10.0)
    assert refined(segment, scene).fine is None


def test_a_few_cells_tell_nothing() -> None:
    scene, segment = locked(pair(10.2), 10.0)
    mask = np.zeros_like(segment.mask)
    mask[40:43, 80:83] = True
    assert refined(replace(segment, mask=mask, box=(80, 40, 83, 43)), scene).fine is None


def test_a_body_is_measured_by_it_and_more_precisely() -> None:
    scene, segment = locked(pair(10.3), 10.0)
    fine = refined(segment, scene)
    place, cov = measured_anchor(fine, "middle", scene)
    coarse_place, coarse_cov = measured_anchor(segment, "middle", scene)
    camera = GRID.camera
    assert place[2] == pytest.approx(camera.fb / (10.3 * RED), abs=0.02)
    assert abs(coarse_place[2] - place[2]) > 0.05
    assert cov[2, 2] < 0.6 * coarse_cov[2, 2]


@pytest.mark.parametrize("changes", [{"uncovered": 0.8}, {"cut": (True, False, False, False)}])
def test_a_segment_without_borders_of_its_own_is_not_more_certain(
    changes: dict[str, object],
) -> None:
    scene, segment = locked(pair(10.3), 10.0)
    fine = refined(segment, scene)
    assert fine.fine is not None
    bordered = measured_anchor(fine, "middle", scene)[1]
    borderless = measured_anchor(replace(fine, **changes), "middle", scene)[1]  # type: ignore[arg-type]
    assert borderless[2, 2] > 1.5 * bordered[2, 2]
