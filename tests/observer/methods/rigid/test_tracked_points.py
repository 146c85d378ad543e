"""Tracked points: each keeps its own data."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from observer.methods.rigid.position_velocity_filter import PositionVelocityFilter
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.vision.lifecycle import NO_OBSTACLE


def some(count: int, first_number: int = 0) -> TrackedPoints:
    """Points whose every attribute encodes their number."""
    values = np.arange(first_number, first_number + count, dtype=np.float64)
    tall = np.broadcast_to(values[:, None, None] + 1, (count, 3, 3)) * np.eye(3)
    pairs = np.stack([values, values], axis=1).astype(np.float32)
    sums = PositionVelocityFilter.begin(np.repeat(values[:, None], 3, axis=1), tall)
    points = TrackedPoints.begin(first_number, pairs, pairs - 8, values + 8, sums)
    return points.but(
        flow=pairs.astype(np.float64),
        sightings=values.astype(np.int64),
        age=values,
        dynamic=values % 2 == 1,
        obstacle=values.astype(np.int64),
        tenure=values.astype(np.int64),
        shape_information=tall,
        shape_vector=np.repeat(values[:, None], 3, axis=1),
    )


def columns(points: TrackedPoints) -> dict[str, np.ndarray]:
    """Every array that is kept, including those of the sums."""
    kept = {f.name: getattr(points, f.name) for f in fields(TrackedPoints) if f.name != "sums"}
    return kept | {
        f"sums.{f.name}": getattr(points.sums, f.name) for f in fields(PositionVelocityFilter)
    }


def assert_same(points: TrackedPoints, expected: dict[str, np.ndarray]) -> None:
    for name, value in columns(points).items():
        np.testing.assert_array_equal(value, expected[name], err_msg=name)
        assert value.dtype == expected[name].dtype, name


def test_an_empty_set_of_points_is_valid() -> None:
    none = TrackedPoints.none()
    assert len(none) == 0
    assert {len(value) for value in columns(none).values()} == {0}
    assert len(none.take(np.zeros(0, np.bool_))) == 0


def test_joining_with_an_empty_set_changes_nothing() -> None:
    for both in (TrackedPoints.none().joined(some(4)), some(4).joined(TrackedPoints.none())):
        assert_same(both, columns(some(4)))


def test_new_points_have_unique_numbers_and_no_history() -> None:
    px = np.array([[10, 20], [30, 40]], np.float32)
    sums = PositionVelocityFilter.begin(np.zeros((2, 3)), np.broadcast_to(np.eye(3), (2, 3, 3)))
    right = px - np.array([5, 0], np.float32)
    points = TrackedPoints.begin(17, px, right, np.array([5.0, 5.0]), sums)
    assert len(points) == 2
    assert points.number.tolist() == [17, 18]
    assert points.sightings.tolist() == [1, 1]
    assert points.age.tolist() == [0, 0]
    assert np.isnan(points.flow).all()
    assert not points.dynamic.any()
    assert (points.obstacle == NO_OBSTACLE).all()
    assert not points.shape_information.any()
    assert {len(value) for value in columns(points).values()} == {2}


@pytest.mark.parametrize("which", [np.array([True, False, True, False, True]), np.array([4, 0, 2])])
def test_taken_points_keep_all_data(which: np.ndarray) -> None:
    points = some(5)
    assert_same(points.take(which), {k: value[which] for k, value in columns(points).items()})


def test_joined_points_keep_their_order_and_all_data() -> None:
    first, second = some(3), some(2, first_number=3)
    assert_same(first.joined(second), columns(some(5)))
    parted = some(5).take(np.arange(3, 5)).joined(some(5).take(np.arange(3)))
    assert parted.number.tolist() == [3, 4, 0, 1, 2]


def test_a_change_affects_neither_other_fields_nor_the_original() -> None:
    points = some(3)
    changed = points.but(age=np.full(3, 9.0))
    assert changed.age.tolist() == [9, 9, 9]
    assert_same(changed.but(age=points.age), columns(some(3)))
    assert_same(points, columns(some(3)))
    with pytest.raises(TypeError):
        points.but(colour=1)


def test_points_not_measured_for_long_are_discarded() -> None:
    points = some(3)
    for _ in range(600):
        seen = np.where(np.array([1.0, 0.0, 1.0])[:, None, None] > 0, np.eye(3), 0.0)
        sums = points.sums.advanced(0.1, 1.0).with_sightings(points.sums.origin, seen)
        points = points.but(sums=sums)
    assert points.remembered().number.tolist() == [0, 2]
    assert np.isfinite(points.remembered().sums.velocity_information()[0]).all()
    young = some(3)
    assert young.remembered() is young
