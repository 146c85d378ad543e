"""One obstacle as a body: the motion of its points while its origin moves and turns."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from observer.geometry import Pose
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import YAW, YAW_RATE, BodyFilter, yaw_matrix
from observer.methods.rigid.bodies.shape import Box

from ..solid_worlds import CAMERA, Solid, outline_of

MakeTrack = Callable[..., BodyTrack]
SIZE = np.array([0.4, 0.3, 0.6])
OFFSET = np.array([0.3, -0.05, 0.5])
BOX = Box(OFFSET, SIZE, 0.4)


@pytest.fixture
def turning(make_track: MakeTrack) -> BodyTrack:
    """Drives at 0.3 m/s at a yaw of 0.5 rad and turns by 0.8 rad/s, not about its centre."""
    return make_track(yaw=0.5, yaw_rate=0.8, box=BOX)


def soon(track: BodyTrack, dt: float) -> BodyTrack:
    """The same body a little later, exactly: on a circle without noise."""
    later = track.filter
    for _ in range(20):
        later = later.predicted(dt / 20, (0, 0), (0, 0), None)
    return BodyTrack(id=1, filter=later, shape=track.shape, box=track.box)


def test_the_centre_is_the_box_centre_in_the_world(turning: BodyTrack) -> None:
    expected = turning.mean[:3] + yaw_matrix(0.5) @ OFFSET
    np.testing.assert_allclose(turning.centre, expected)
    assert turning.yaw == 0.5
    assert turning.yaw_rate == 0.8
    np.testing.assert_allclose(turning.R, yaw_matrix(0.5))


def test_the_centre_velocity_is_the_derivative_of_the_centre(turning: BodyTrack) -> None:
    velocity, _ = turning.centre_velocity()
    moved = (soon(turning, 1e-4).centre - turning.centre) / 1e-4
    np.testing.assert_allclose(velocity, moved, atol=1e-4)
    # unlike its origin
    assert np.linalg.norm(velocity - turning.mean[3:6]) > 0.3


def test_yaw_rate_uncertainty_propagates_to_the_centre_velocity(make_track: MakeTrack) -> None:
    track = make_track(yaw=0.5, yaw_rate=0.0, box=BOX)
    sigma = 0.2
    track.filter.covariances[:, YAW_RATE, YAW_RATE] = sigma**2
    _, cov = track.centre_velocity()
    rng = np.random.default_rng(0)
    arm = track.R @ OFFSET
    drawn = [
        rng.normal(0, 0.01, 3) + np.cross([0, rng.normal(0, sigma), 0], arm) for _ in range(20000)
    ]
    np.testing.assert_allclose(cov, np.cov(np.transpose(drawn)), atol=0.05 * np.trace(cov))
    assert np.trace(cov) > 10 * np.trace(track.filter.covariance[3:6, 3:6])


def test_uncertainty_of_the_centre_makes_a_turning_velocity_less_certain(
    make_track: MakeTrack,
) -> None:
    """The centre is uncertain, so a turning body's velocity is less certain, horizontally only."""
    covs = [
        make_track(yaw_rate=rate, box=Box(np.zeros(3), SIZE, 0.0)).centre_velocity()[1]
        for rate in (0.0, 1.0)
    ]
    more = covs[1] - covs[0]
    assert 0.02 < np.sqrt(more[0, 0]) < 0.3
    assert more[2, 2] == pytest.approx(more[0, 0])
    assert more[1, 1] == pytest.approx(0.0, abs=1e-12)
    big = make_track(yaw_rate=1.0, box=Box(np.zeros(3), 5 * SIZE, 0.0)).centre_velocity()[1]
    assert big[0, 0] > 10 * covs[1][0, 0]


def test_a_body_without_a_box_is_a_point_at_its_origin(make_track: MakeTrack) -> None:
    track = make_track(yaw_rate=1.0)
    track.box = None
    np.testing.assert_array_equal(track.centre, [0, 0, 3])
    np.testing.assert_array_equal(track.centre_velocity()[0], [0.3, 0, 0])
    assert track.room(0.15) == 0.0
    assert track.contains(np.array([[0.0, 0, 3], [0.1, 0, 3]])).tolist() == [False, False]
    np.testing.assert_array_equal(track.corners(), np.tile([0.0, 0, 3], (8, 1)))


def test_velocity_at_a_position_matches_the_motion_of_body_points(turning: BodyTrack) -> None:
    local = np.random.default_rng(1).normal(0, 0.4, (20, 3))
    places = turning.mean[:3] + local @ turning.R.T
    later = soon(turning, 1e-4)
    moved = later.mean[:3] + local @ later.R.T
    np.testing.assert_allclose(turning.velocity_at(places), (moved - places) / 1e-4, atol=1e-4)
    np.testing.assert_allclose(turning.local(places), local, atol=1e-12)


def test_the_corners_are_those_of_the_box(turning: BodyTrack) -> None:
    corners = turning.corners()
    np.testing.assert_allclose(corners.mean(axis=0), turning.centre)
    assert turning.contains(corners, 1e-9).all()
    assert not turning.contains(corners, -1e-3).any()
    # Along its own axes, given by its yaw and the box's heading, it is as large as the box.
    along = (corners - turning.centre) @ yaw_matrix(0.5 + 0.4)
    np.testing.assert_allclose(np.ptp(along, axis=0), SIZE)


def test_a_body_contains_the_points_in_its_box_at_any_yaw(turning: BodyTrack) -> None:
    rng = np.random.default_rng(2)
    own = rng.uniform(-1, 1, (500, 3)) * SIZE
    places = turning.centre + own @ yaw_matrix(0.9).T
    inside = (np.abs(own) <= SIZE / 2).all(axis=1)
    assert 0 < inside.sum() < 500
    assert turning.contains(places).tolist() == inside.tolist()
    margin = rng.uniform(0, 0.3, 500)
    wider = (np.abs(own) <= SIZE / 2 + margin[:, None]).all(axis=1)
    assert turning.contains(places, margin).tolist() == wider.tolist()
    assert turning.room(0.15) == pytest.approx(0.15 * 0.6)


def test_rebasing_moves_the_origin_to_the_centre_and_changes_nothing_else(
    turning: BodyTrack,
) -> None:
    rng = np.random.default_rng(3)
    A = rng.normal(0, 0.02, (8, 8))
    turning.filter = BodyFilter(
        turning.filter.means,
        np.stack([A @ A.T + 1e-4 * np.eye(8)] * 2),
        turning.filter.probabilities,
    )
    centre, corners = turning.centre, turning.corners()
    velocity, cov = turning.centre_velocity()
    places = rng.normal(0, 1, (10, 3))
    material = turning.velocity_at(places)
    local = turning.local(places)
    offset = turning.rebase()
    np.testing.assert_array_equal(offset, OFFSET)
    assert turning.box is not None
    np.testing.assert_array_equal(turning.box.centre, 0)
    np.testing.assert_allclose(turning.mean[:3], centre)
    np.testing.assert_allclose(turning.centre, centre)
    np.testing.assert_allclose(turning.corners(), corners)
    np.testing.assert_allclose(turning.centre_velocity()[0], velocity)
    np.testing.assert_allclose(turning.velocity_at(places), material)
    np.testing.assert_allclose(turning.local(places), local - offset)
    assert turning.mean[YAW] == 0.5
    # The yaw error also moves the lever, which centre_velocity ignored before rebasing.
    np.testing.assert_allclose(
        np.diag(turning.centre_velocity()[1]), np.diag(cov), rtol=0.25, atol=1e-6
    )


def test_rebasing_leaves_remembered_positions_unchanged_in_the_world(turning: BodyTrack) -> None:
    rng = np.random.default_rng(4)
    local = OFFSET + rng.uniform(-0.2, 0.2, (40, 3))
    for _ in range(6):
        turning.shape.note(local)
    view = np.array([1.0, 0.0, 1.0])
    before = turning.shape.box(local[:4], view, 0.1)
    offset = turning.rebase()
    after = turning.shape.box(local[:4] - offset, view, 0.0)
    np.testing.assert_allclose(after.centre, before.centre - offset, atol=1e-12)
    np.testing.assert_allclose(after.size, before.size)


def with_offset(track: BodyTrack) -> BodyTrack:
    """Give the track an outline that was noted once."""
    track.outline = outline_of(Solid((0.0, 0.0, 4.0), (0.45, 1.2, 0.1)))
    track.outline.offsets["middle"] = np.array([0.1, 0.0, 0.0])
    return track


def test_a_loosened_body_keeps_its_motion_but_stops_turning(turning: BodyTrack) -> None:
    before = turning.filter
    turning.loosen()
    assert (turning.rigid, turning.rigidity) == (False, 0.0)
    np.testing.assert_array_equal(turning.mean[:YAW_RATE], before.mean[:YAW_RATE])
    assert turning.yaw_rate == 0.0


def test_a_stiffened_body_takes_the_motion_of_its_points_and_resets_its_shape(
    turning: BodyTrack, make_track: MakeTrack
) -> None:
    track = with_offset(turning)
    for _ in range(6):
        track.shape.note(np.zeros((8, 3)))
    track.recent.note(0.1, np.array([1.0, 0.0, 0.0]), 0.2)
    track.loosen()
    motion = make_track((0.2, 0.0, 3.5), (0.6, 0.0, 0.1)).filter
    track.stiffen(motion)
    assert (track.rigid, track.rigidity) == (True, 1.0)
    assert track.filter is motion
    assert track.outline.offsets == {}
    assert track.shape.axis(track.yaw) is None
    # it keeps its identity
    assert track.id == 1


def test_a_body_without_an_outline_can_be_stiffened(turning: BodyTrack) -> None:
    turning.loosen()
    turning.stiffen(turning.filter)
    assert turning.rigid


def test_the_box_of_an_unseen_body_moves_with_its_prediction(
    make_track: MakeTrack,
) -> None:
    """It moves with the predicted place, grows as that comes nearer, and leaves the image."""
    track = make_track((0.0, 0.0, 4.0), (1.0, 0.0, -1.0))

    def around() -> tuple[float, float, float, float]:
        px, d = CAMERA.project(track.centre[None])
        (u, v), half = px[0], d[0]
        return (u - half, v - 2 * half, u + half, v + 2 * half)

    track.box_px = around()
    track.carry_box(Pose.identity(), CAMERA)
    assert track.box_px == around()
    track.missed_s = 0.1
    for _ in range(20):
        track.filter = track.filter.predicted(0.1, (0, 0), (0, 0), None)
        track.carry_box(Pose.identity(), CAMERA)
        assert track.box_px == pytest.approx(around())
    assert track.box_px[0] > CAMERA.width * 0.75


def test_the_box_of_a_visible_body_stays_where_it_was_measured(make_track: MakeTrack) -> None:
    track = make_track()
    track.box_px = (10.0, 20.0, 30.0, 40.0)
    for x in (0.0, 0.2):
        track.carry_box(Pose(np.eye(3), np.array([x, 0.0, 0.0])), CAMERA)
    assert track.box_px == (10.0, 20.0, 30.0, 40.0)
