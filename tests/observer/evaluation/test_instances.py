"""Distances of reported obstacles from true bodies."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.evaluation.instances import Instance, axis_distance, centre_distance
from observer.truth.contract import TrueBody

HEIGHT_M = 1.7
CENTRE = np.array([0.5, 0.2, 4.0])
lengths = st.floats(-3, 3)


def body() -> TrueBody:
    size = np.array([0.3, 0.5, HEIGHT_M])
    return TrueBody(1, "Ada", "obstacle", CENTRE.copy(), np.zeros(3), size, 0.0, 1.0, None)


def seen_at(x: float, y: float, z: float) -> Instance:
    """Return an instance at this offset from the body's centre."""
    return Instance((0, 1), CENTRE + np.array([x, y, z]), np.zeros(3), None, 0.0, 0.0, None)


@given(x=lengths, y=st.floats(-HEIGHT_M / 2, HEIGHT_M / 2), z=lengths)
def test_height_is_ignored_beside_a_body(x: float, y: float, z: float) -> None:
    assert axis_distance(body(), seen_at(x, y, z)) == pytest.approx(np.hypot(x, z), abs=1e-9)


@given(x=lengths, above=st.floats(0, 3), sign=st.sampled_from([-1, 1]))
def test_only_the_excess_beyond_the_axis_counts_above_and_below(
    x: float, above: float, sign: int
) -> None:
    instance = seen_at(x, sign * (HEIGHT_M / 2 + above), 0.0)
    assert axis_distance(body(), instance) == pytest.approx(np.hypot(x, above), abs=1e-9)


@given(x=lengths, y=lengths, z=lengths)
def test_axis_distance_is_within_half_a_height_below_centre_distance(
    x: float, y: float, z: float
) -> None:
    instance = seen_at(x, y, z)
    axis, centre = axis_distance(body(), instance), centre_distance(body(), instance)
    assert axis <= centre + 1e-9
    assert axis >= centre - HEIGHT_M / 2 - 1e-9


def test_axis_distance_modifies_neither_body_nor_instance() -> None:
    true, instance = body(), seen_at(0.1, 0.5, 0.2)
    before = instance.position.copy()
    assert axis_distance(true, instance) == axis_distance(true, instance)
    np.testing.assert_array_equal(true.position, CENTRE)
    np.testing.assert_array_equal(instance.position, before)
