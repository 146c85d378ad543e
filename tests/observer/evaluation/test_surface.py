"""The visible surface of a box, by its position and heading."""

from __future__ import annotations

import numpy as np
import pytest

from observer.evaluation.surface import visible_surface
from observer.truth.contract import TrueBody


def box(position: tuple[float, float, float], yaw: float = 0.0) -> TrueBody:
    """Return a box 0.6 m long, 0.4 m wide and 0.2 m high."""
    return TrueBody(
        id=1,
        name="box",
        role="obstacle",
        position=np.array(position),
        velocity=np.zeros(3),
        size=np.array([0.6, 0.4, 0.2]),
        yaw=yaw,
        visible=1.0,
        commanded_speed=None,
    )


@pytest.mark.parametrize(
    ("yaw", "depth", "side"),
    [(0.0, 0.3, 1), (np.pi, 0.3, 0), (np.pi / 2, 0.2, 2), (-np.pi / 2, 0.2, 3)],
)
def test_only_the_near_face_is_visible_straight_ahead(yaw: float, depth: float, side: int) -> None:
    seen = visible_surface(box((0, 0, 3), yaw), np.zeros(3))
    np.testing.assert_allclose(seen.centre, (0, 0, 3 - depth), atol=1e-9)
    assert seen.sides == {side}


def test_both_faces_are_visible_at_a_corner() -> None:
    seen = visible_surface(box((0, 0, 3), np.pi / 4), np.zeros(3))
    assert seen.sides == {1, 2}
    assert 2.7 < seen.centre[2] < 2.95


def test_top_counts_when_seen_from_above() -> None:
    seen = visible_surface(box((0, 1.0, 0.5)), np.zeros(3))
    assert seen.centre[1] < 0.99


def test_whole_box_counts_from_inside() -> None:
    seen = visible_surface(box((0, 0, 0.05)), np.zeros(3))
    np.testing.assert_allclose(seen.centre, (0, 0, 0.05))
    assert seen.sides == frozenset()
