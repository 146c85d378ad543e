"""Which segments are limbs of a body, and which are separate things."""

from __future__ import annotations

import numpy as np
import pytest

from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import Segment, is_limb, segment_of, with_limb

from ..solid_worlds import ROOM, Shape, Solid, arrived, cells_of

TRUNK = Solid((0.0, -0.2, 4.0), (0.5, 0.8, 0.25))
LEG = Solid((0.1, 0.5, 3.95), (0.18, 0.5, 0.15))


def parts(*things: Shape) -> tuple[DenseScene, list[Segment]]:
    scene = arrived(*things)
    masks = [cells_of(thing, [*ROOM, *things]) & scene.standing for thing in things]
    return scene, [segment_of(scene, mask) for mask in masks]


def test_a_leg_below_a_trunk_is_a_limb() -> None:
    scene, (trunk, leg) = parts(TRUNK, LEG)
    assert is_limb(scene, leg, trunk)
    whole = with_limb(scene, trunk, leg)
    np.testing.assert_array_equal(whole.mask, trunk.mask | leg.mask)
    assert whole.box[3] == leg.box[3]


def test_a_small_hand_beside_a_trunk_is_a_limb() -> None:
    hand = Solid((0.38, 0.1, 3.9), (0.15, 0.2, 0.15))
    scene, (trunk, small) = parts(TRUNK, hand)
    assert is_limb(scene, small, trunk)


@pytest.mark.parametrize(
    "other",
    [
        pytest.param(Solid((0.7, -0.2, 4.0), (0.5, 0.8, 0.25)), id="another body beside it"),
        pytest.param(Solid((0.1, 0.5, 2.4), (0.18, 0.5, 0.15)), id="something nearer"),
        pytest.param(Solid((0.1, 0.75, 5.6), (0.3, 0.3, 0.15)), id="something farther"),
        pytest.param(Solid((1.1, 0.1, 4.0), (0.15, 0.2, 0.15)), id="something small far aside"),
    ],
)
def test_other_objects_are_not_limbs(other: Solid) -> None:
    scene, (trunk, part) = parts(TRUNK, other)
    assert not is_limb(scene, part, trunk)


def test_background_between_the_legs_is_absorbed_but_not_added_to_the_body() -> None:
    """Its depth lies between a limb's and that of another thing."""
    between = Solid((0.1, 0.5, 4.9), (0.18, 0.5, 0.15))
    scene, (trunk, part) = parts(TRUNK, between)
    assert is_limb(scene, part, trunk)
    assert with_limb(scene, trunk, part) is trunk
