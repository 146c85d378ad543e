"""The box of an obstacle, from points whose places on it are known."""

from __future__ import annotations

import numpy as np
import pytest

from observer.methods.rigid.bodies.filter import yaw_matrix
from observer.methods.rigid.bodies.shape import BodyShape, Box

# Metres: width across the heading, height, length along the heading.
SIZE = np.array([0.4, 0.3, 0.7])
SURE = np.eye(3) * 0.01**2
# Seconds in view after which a side is known.
LONG = 2.0


def face(rng: np.random.Generator, axis: int, sign: int, count: int = 400) -> np.ndarray:
    """Points (N, 3) on one face of a box about the origin whose heading is z."""
    points = rng.uniform(-SIZE / 2, SIZE / 2, (count, 3))
    points[:, axis] = sign * SIZE[axis] / 2
    return points


def heading_for(shape: BodyShape, heading: float, yaw: float = 0.0) -> None:
    for _ in range(20):
        velocity = 0.4 * yaw_matrix(heading + yaw) @ [0, 0, 1]
        shape.note_heading(velocity, SURE, yaw)


def same_axis(a: float, b: float) -> float:
    """Radians between two axes, regardless of their direction."""
    return abs(float((a - b + np.pi / 2) % np.pi - np.pi / 2))


@pytest.mark.parametrize("heading", [0.0, 0.6, -1.1])
def test_box_and_heading_are_learned_from_two_faces(heading: float) -> None:
    rng, shape = np.random.default_rng(0), BodyShape()
    heading_for(shape, heading)
    R = yaw_matrix(heading)
    centre = np.array([0.3, 0.1, -0.2])
    points = np.concatenate([face(rng, 0, -1), face(rng, 2, -1)]) @ R.T + centre
    # Seen from where both faces are visible.
    box = shape.box(points, R @ np.array([1.0, 0.0, 1.0]), LONG)
    assert same_axis(box.heading, heading) < 0.01
    np.testing.assert_allclose(box.size, SIZE, rtol=0.1)
    np.testing.assert_allclose(box.centre, centre, atol=0.03)
    inside = rng.uniform(-0.4, 0.4, (50, 3)) * SIZE @ R.T + centre
    assert box.contains(inside).all()
    assert not box.contains(centre + R @ [0, 0, 0.45] + np.zeros((1, 3))).any()


@pytest.mark.parametrize(("axis", "other"), [(0, 2), (2, 0)])
@pytest.mark.parametrize("sign", [-1, 1])
def test_an_unseen_side_is_completed_behind_the_visible_face(
    axis: int, other: int, sign: int
) -> None:
    rng, shape = np.random.default_rng(1), BodyShape()
    heading_for(shape, 0.0)
    view = np.zeros(3)
    view[axis] = -sign
    box = shape.box(face(rng, axis, sign), view, LONG)
    assert box.size[other] == pytest.approx(SIZE[other], rel=0.1)
    # Its depth is unknown, but it is not flat, and not nearer than what is seen.
    assert 0.5 * SIZE[other] < box.size[axis] < 1.2 * SIZE[other]
    seen = sign * SIZE[axis] / 2
    assert box.centre[axis] + sign * box.size[axis] / 2 == pytest.approx(seen, abs=0.01)
    assert sign * box.centre[axis] < sign * seen


def test_the_length_of_a_side_is_trusted_more_the_longer_it_is_seen() -> None:
    """At first there are few points on a face that comes into view."""
    rng, shape = np.random.default_rng(7), BodyShape()
    heading_for(shape, 0.0)
    thin = np.concatenate([face(rng, 0, -1), face(rng, 2, -1) * [0.3, 1.0, 1.0]])
    thin[:, 0] = np.maximum(thin[:, 0], -0.06)
    corner, front = np.array([1.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.2])
    usual = shape.box(thin, front, LONG).size[0]
    assert usual > 0.75 * SIZE[2]
    widths = [shape.box(thin, corner, 0.1).size[0] for _ in range(80)]
    assert widths[0] > 0.9 * usual
    assert all(np.diff(widths) <= 0)
    assert widths[-1] < 0.15


def test_a_first_guess_of_the_heading_does_not_fix_which_face_is_which() -> None:
    rng, shape = np.random.default_rng(8), BodyShape()
    # It seems to drive along x, then turns out to drive along z: the visible face is its front.
    shape.note_heading(np.array([0.1, 0.0, 0.0]), np.eye(3) * 0.02**2, 0.0)
    shape.box(face(rng, 2, -1), np.array([0.0, 0.0, 1.0]), LONG)
    heading_for(shape, 0.0)
    box = shape.box(face(rng, 2, -1), np.array([0.0, 0.0, 1.0]), LONG)
    assert box.size[2] > 0.5 * SIZE[0]


def test_a_hidden_face_is_remembered() -> None:
    rng, shape = np.random.default_rng(2), BodyShape()
    heading_for(shape, 0.0)
    for _ in range(30):
        both = np.concatenate([face(rng, 0, -1, 20), face(rng, 2, -1, 20)])
        shape.note(both)
    shape.box(both, np.array([1.0, 0.0, 1.0]), LONG)
    for _ in range(9):
        shape.note(face(rng, 2, -1, 20))
    box = shape.box(face(rng, 2, -1, 20), np.array([0.0, 0.0, 1.0]), LONG)
    np.testing.assert_allclose(box.size, SIZE, rtol=0.15)
    np.testing.assert_allclose(box.centre, 0, atol=0.06)


def shown(rng: np.random.Generator, view: np.ndarray) -> np.ndarray:
    """Points (N, 3) on the faces towards the camera, fewer on faces seen obliquely."""
    faces = [face(rng, k, -int(np.sign(view[k])), int(40 * abs(view[k]))) for k in (0, 2)]
    return np.concatenate(faces)


def test_the_centre_is_stable_while_a_body_turns() -> None:
    """Its faces come and go; none of them drags the centre along."""
    rng, shape = np.random.default_rng(9), BodyShape()
    heading_for(shape, 0.0)
    centres, sizes = [], []
    for angle in np.arange(0.3, 0.3 + 4 * np.pi, 0.06):
        view = np.array([np.sin(angle), 0.0, np.cos(angle)])
        points = shown(rng, view)
        shape.note(points)
        box = shape.box(points, view, 0.07)
        centres.append(box.centre[[0, 2]])
        sizes.append(box.size[[0, 2]])
    after = len(centres) // 2
    assert np.abs(sizes[after:] - SIZE[[0, 2]]).max() < 0.03
    assert np.linalg.norm(centres[after:], axis=1).max() < 0.02
    # and it does not jump when a face is seen edge-on.
    assert np.linalg.norm(np.diff(centres[after:], axis=0), axis=1).max() < 0.02


def test_a_side_keeps_its_length_after_its_points_are_forgotten() -> None:
    rng, shape = np.random.default_rng(10), BodyShape()
    heading_for(shape, 0.0)
    corner, front = np.array([1.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0])
    both = np.concatenate([face(rng, 0, -1, 60), face(rng, 2, -1, 60)])
    for _ in range(90):
        shape.note(both)
        shape.box(both, corner, 0.1)
    sizes = []
    for _ in range(90):
        few = face(rng, 2, -1, 20) * [0.5, 1.0, 1.0]
        shape.note(few)
        sizes.append(shape.box(few, front, 0.1).size)
    np.testing.assert_allclose(sizes[-1][[0, 2]], SIZE[[0, 2]], rtol=0.15)


def test_wrong_points_do_not_stretch_the_box_permanently() -> None:
    rng, shape = np.random.default_rng(11), BodyShape()
    heading_for(shape, 0.0)
    corner = np.array([1.0, 0.0, 1.0])
    both = np.concatenate([face(rng, 0, -1, 60), face(rng, 2, -1, 60)])
    before = shape.box(both, corner, 2.0).size
    strangers = np.concatenate([both, both[:12] + np.array([0.5, 0.0, 0.0])])
    assert shape.box(strangers, corner, 0.07).size[0] > 1.3 * before[0]
    assert shape.box(both, corner, 0.07).size[0] < 1.1 * before[0]


def test_the_centre_is_more_certain_after_both_sides_were_seen() -> None:
    rng, shape = np.random.default_rng(12), BodyShape()
    heading_for(shape, 0.0)
    both = np.concatenate([face(rng, 0, -1), face(rng, 2, -1)])
    unseen = shape.centre_doubt
    for _ in range(100):
        shape.box(both, np.array([0.0, 0.0, 1.0]), 0.1)
    assert shape.centre_doubt == unseen
    for _ in range(100):
        shape.box(both, np.array([1.0, 0.0, 1.0]), 0.1)
    assert shape.centre_doubt < 0.5 * unseen
    shape.forget()
    assert shape.centre_doubt == unseen


def test_a_few_wrong_points_do_not_stretch_the_box() -> None:
    rng, shape = np.random.default_rng(3), BodyShape()
    heading_for(shape, 0.0)
    points = np.concatenate([face(rng, 0, -1), face(rng, 2, -1)])
    points[:8] += [2.0, 0.5, 2.0]
    points[8:16, :] = np.nan
    box = shape.box(points, np.array([1.0, 0.0, 1.0]), LONG)
    np.testing.assert_allclose(box.size, SIZE, rtol=0.15)


def test_a_few_points_that_each_stray_along_another_axis_still_have_a_box() -> None:
    points = np.diag([1.0, 2.0, 3.0])
    box = BodyShape().box(points, np.array([0.0, 0.0, 1.0]), LONG)
    assert np.isfinite(box.size).all()
    assert box.contains(points.mean(axis=0, keepdims=True), 0.0).all()


def test_shift_moves_the_origin_of_remembered_positions() -> None:
    rng = np.random.default_rng(4)
    view, offset = np.array([1.0, 0.0, 1.0]), np.array([0.2, -0.1, 0.3])
    both = np.concatenate([face(rng, 0, -1, 20), face(rng, 2, -1, 20)])
    boxes = []
    for shift in (False, True):
        shape = BodyShape()
        heading_for(shape, 0.3)
        for _ in range(12):
            shape.note(both)
        if shift:
            shape.shift(offset)
        boxes.append(shape.box(both[:5] - offset * shift, view, LONG))
    np.testing.assert_allclose(boxes[1].centre, boxes[0].centre - offset, atol=1e-12)
    np.testing.assert_allclose(boxes[1].size, boxes[0].size)


def test_forget_discards_remembered_positions() -> None:
    rng, shape = np.random.default_rng(5), BodyShape()
    heading_for(shape, 0.0)
    elsewhere = np.concatenate([face(rng, 0, -1, 20), face(rng, 2, -1, 20)])
    elsewhere += np.array([5.0, 0.0, 5.0])
    for _ in range(30):
        shape.note(elsewhere)
    shape.forget()
    both = np.concatenate([face(rng, 0, -1), face(rng, 2, -1)])
    box = shape.box(both, np.array([1.0, 0.0, 1.0]), LONG)
    np.testing.assert_allclose(box.size, SIZE, rtol=0.1)
    np.testing.assert_allclose(box.centre, 0, atol=0.03)
    # but it keeps its heading
    assert same_axis(box.heading, 0.0) < 0.01


def test_a_lost_body_keeps_its_size() -> None:
    """Found again, it shows one face, but does not become flatter."""
    rng, shape = np.random.default_rng(6), BodyShape()
    heading_for(shape, 0.0)
    both = np.concatenate([face(rng, 0, -1, 20), face(rng, 2, -1, 20)])
    for _ in range(30):
        shape.note(both)
    before = shape.box(both, np.array([1.0, 0.0, 1.0]), LONG)
    shape.forget()
    after = shape.box(face(rng, 2, -1), np.array([0.0, 0.0, 1.0]), LONG)
    np.testing.assert_allclose(after.size, before.size, rtol=0.2)


def test_the_heading_is_unknown_until_the_body_certainly_moves() -> None:
    shape = BodyShape()
    assert shape.axis(0.0) is None
    shape.note_heading(np.array([0.02, 0.0, 0.0]), SURE, 0.0)
    assert shape.axis(0.0) is None
    shape.note_heading(np.array([0.2, 0.0, 0.0]), SURE, 0.0)
    axis = shape.axis(0.0)
    assert axis is not None
    np.testing.assert_allclose(np.abs(axis), [1, 0, 0], atol=1e-12)


def test_back_and_forth_motion_gives_one_axis_that_turns_with_the_body() -> None:
    shape = BodyShape()
    for k in range(40):
        yaw = 0.05 * k
        forward = yaw_matrix(0.4 + yaw) @ [0, 0, 0.3]
        shape.note_heading(forward if k % 2 else -forward, SURE, yaw)
    axis = shape.axis(1.0)
    assert axis is not None
    assert np.linalg.norm(axis) == pytest.approx(1.0)
    assert abs(axis @ (yaw_matrix(1.4) @ [0, 0, 1])) == pytest.approx(1.0, abs=1e-6)


def test_a_box_contains_points_within_its_margin() -> None:
    box = Box(np.array([1.0, 0.0, 2.0]), SIZE, np.pi / 2)
    # Its long way is x now.
    places = box.centre + np.array([[0.34, 0, 0], [0, 0, 0.34], [0.4, 0, 0], [0, 0.14, 0.19]])
    assert box.contains(places).tolist() == [True, False, False, True]
    assert box.contains(places, 0.06).tolist() == [True, False, True, True]
    each = np.array([0.0, 0.2, 0.0, -0.1])
    assert box.contains(places, each).tolist() == [True, True, False, False]
