"""The pair that a cloud is made from, and the cloud, on a textured wall at a known distance."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from app.engine.dense_stereo import PairKeeper, cloud_of, cloud_value, coarseness, dense_stereo
from app.engine.observed import Observed
from observer.camera import StereoCamera
from observer.geometry import Pose
from observer.obstacle_colors import OBSTACLE_RGB
from observer.parameters import Parameters, StereoParameters
from observer.types import Observation, Status, StereoFrame

from .test_pictures import obstacle

DISPARITY_PX = 24
BASELINE_M = 0.2


def wall(width: int, height: int) -> tuple[Any, Any]:
    rng = np.random.default_rng(3)
    noise = rng.integers(0, 256, (height // 3 + 1, (width + 64) // 3 + 1), dtype=np.uint8)
    wide = cv2.resize(noise, (width + 64, height), interpolation=cv2.INTER_CUBIC)
    # A point at u in the left image is at u - disparity in the right one.
    return (
        np.ascontiguousarray(wide[:, :width]),
        np.ascontiguousarray(wide[:, DISPARITY_PX : DISPARITY_PX + width]),
    )


def camera(width: int, height: int) -> StereoCamera:
    return StereoCamera(width, height, 300.0, 310.0, width / 2 - 3.2, height / 2 + 1.7, BASELINE_M)


def observed(index: int, *, width: int = 160, height: int = 120, **trace: Any) -> Observed:
    left, right = wall(width, height)
    frame = StereoFrame(index, index / 10, left, right, received=50.0 + index)
    pose = Pose(np.eye(3), np.array([0.0, 0.0, 0.1 * index]))
    observation = Observation(
        index, frame.time, frame.received, 2, Status.OK, ("weak",), 1, pose, ()
    )
    trace = {"left": left, "right": right} | trace
    return Observed(frame, observation, trace, camera(width, height), Parameters(), 0)


def keeper(*frames: Observed) -> PairKeeper:
    made = PairKeeper()
    for frame in frames:
        made.remember(frame)
    return made


def test_without_a_known_disparity_the_newest_pair_and_its_pose_are_used() -> None:
    frames = [observed(k) for k in range(3)]
    pair = keeper(*frames).pair(frames[2])
    assert pair.left is frames[2].trace["left"]
    assert pair.right is frames[2].trace["right"]
    assert pair.disparity is None
    assert (pair.instant["frame"], pair.instant["received"]) == (2, 52.0)
    assert np.reshape(pair.instant["T_world_camera"], (4, 4))[2, 3] == pytest.approx(0.2)


def test_a_known_disparity_keeps_the_pose_of_its_own_instant() -> None:
    known = np.full((120, 160), 9.0, np.float32)
    frames = [observed(k) for k in range(3)]
    newest = observed(3, disparity=known, previous_time=0.1)
    pair = keeper(*frames, newest).pair(newest)
    assert pair.left is frames[1].trace["left"]
    assert pair.instant["frame"] == 1
    dense = dense_stereo(pair)
    assert dense is not None
    assert dense.disparity is known, "what the method computed is not computed again"


def test_a_disparity_whose_pair_was_not_seen_is_not_used() -> None:
    newest = observed(3, disparity=np.zeros((120, 160), np.float32), previous_time=0.1)
    pair = keeper(newest).pair(newest)
    assert (pair.disparity, pair.instant["frame"]) == (None, 3)


def test_a_single_image_has_no_disparity() -> None:
    what = observed(0, right=None)
    assert dense_stereo(keeper(what).pair(what)) is None


@pytest.mark.parametrize(("width", "height"), [(160, 120), (1242, 375)])
def test_the_cloud_lies_on_the_wall_for_any_grid(width: int, height: int) -> None:
    what = observed(0, width=width, height=height)
    pair = keeper(what).pair(what)
    dense = dense_stereo(pair)
    assert dense is not None
    header, (point_bytes, color_bytes) = cloud_value(pair, dense, cloud_of(pair, dense))
    assert header["coarseness"] == (2 if width == 1242 else 1)
    points = np.frombuffer(point_bytes, np.float32).reshape(-1, 3)
    assert header["count"] == len(points) > 500
    assert len(color_bytes) == 3 * len(points)
    z = what.camera.fx * BASELINE_M / DISPARITY_PX
    assert np.median(points[:, 2]) == pytest.approx(z, rel=0.01)
    # Every point lies on the ray of its own pixels; its colour is their mean.
    u, v = what.camera.project(points)[0].T
    colors = np.frombuffer(color_bytes, np.uint8).reshape(-1, 3)[:, 0].astype(float)
    side = header["coarseness"]
    means = cv2.blur(pair.left.astype(np.float32), (side, side), anchor=(0, 0))
    at = [np.round(axis - (side - 1) / 2).astype(int) for axis in (v, u)]
    assert np.abs(means[tuple(at)] - colors).max() <= 1.0


def seen_body(what: Observed, z: float, polygon: NDArray[np.float64]) -> Observed:
    """Return the frame with a body of 0.3 m reported at this depth, in a polygon, px."""
    one = replace(
        obstacle(),
        position_camera=np.array([0.0, 0.0, z]),
        size=np.full(3, 0.3),
        silhouette=(polygon,),
    )
    return replace(what, observation=replace(what.observation, obstacles=(one,)))


@pytest.mark.parametrize(("width", "height"), [(160, 120), (1242, 375)])
def test_only_points_on_a_body_have_its_colour(width: int, height: int) -> None:
    plain = observed(0, width=width, height=height)
    z = plain.camera.fx * BASELINE_M / DISPARITY_PX
    u0, u1, v0, v1 = width // 2, width // 2 + 40, 30, 90
    square = np.array([[u0, v0], [u1, v0], [u1, v1], [u0, v1]], np.float64)

    def cloud(what: Observed) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        pair = keeper(what).pair(what)
        dense = dense_stereo(pair)
        assert dense is not None
        before = dense.image.copy()
        _, (points, colors) = cloud_value(pair, dense, cloud_of(pair, dense))
        assert np.array_equal(dense.image, before)
        return (
            np.frombuffer(points, np.float32).reshape(-1, 3),
            np.frombuffer(colors, np.uint8).reshape(-1, 3).astype(np.int64),
        )

    places, grey = cloud(plain)
    same, colors = cloud(seen_body(plain, z + 0.1, square))
    assert np.array_equal(places, same)
    u, v = plain.camera.project(places)[0].T
    within = (u > u0 + 2) & (u < u1 - 2) & (v > v0 + 2) & (v < v1 - 2)
    without = (u < u0 - 3) | (u > u1 + 3) | (v < v0 - 3) | (v > v1 + 3)
    on_it = np.abs(places[:, 2] - z) < 0.05
    assert np.count_nonzero(within & on_it) > 50
    half = (grey + OBSTACLE_RGB["moving"]) / 2
    assert np.abs(colors - half)[within & on_it].max() <= 1
    assert np.array_equal(colors[without], grey[without])
    # A body nearer than the points behind its polygon does not colour them.
    _, behind = cloud(seen_body(plain, z - 1.0, square))
    assert np.array_equal(behind[on_it], grey[on_it])


def test_obstacles_come_from_the_pair_with_the_known_disparity() -> None:
    known = np.full((120, 160), 9.0, np.float32)
    older = seen_body(observed(1), 2.0, np.zeros((3, 2)))
    newest = observed(3, disparity=known, previous_time=0.1)
    made = keeper(observed(0), older, newest)
    assert made.pair(newest).obstacles == older.observation.obstacles
    assert made.pair(observed(3)).obstacles == ()


def test_the_grid_depends_only_on_sizes() -> None:
    default, deep = StereoParameters(), StereoParameters(max_disparity_px=256)
    assert coarseness(camera(512, 256), default) == 1
    assert coarseness(camera(640, 480), default) == 2
    assert coarseness(camera(1242, 375), default) == 2
    assert coarseness(camera(512, 256), deep) == 2
    assert coarseness(camera(4096, 3000), deep) in (5, 6)
