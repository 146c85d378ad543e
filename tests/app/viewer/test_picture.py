"""What the 3D scene draws of an observation, and what is stale or without a place."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from app.contract.events import EngineState
from app.runtime.latest import Latest
from app.viewer.picture import make_picture, read_cloud
from observer.mount import CameraMount, level_pose
from observer.obstacle_colors import OBSTACLE_RGB


def test_a_picture_contains_one_obstacle(observed: Any) -> None:
    event = observed.observe()
    picture = make_picture(event, observed.state(), 1, event.received + 0.1)
    assert picture.segment == (1, 0)
    assert picture.boxes.shape == (1, 12, 2, 3)
    assert picture.box_colors.tolist() == [list(OBSTACLE_RGB["moving"])]
    assert picture.truth.shape == (1, 12, 2, 3)
    np.testing.assert_allclose(picture.arrows[0, 1] - picture.arrows[0, 0], [0.4, 0, 0])
    assert [tag.text for tag in picture.tags] == ["#7  0.40 ± 0.10 m/s"]
    # The label stands above the box, which is up in the display and -y in the camera.
    assert picture.tags[0].position[1] < 0
    assert picture.optics == pytest.approx((2 * math.atan(128 / 443), 2.0))
    assert picture.floor_known
    assert not picture.stale
    event.line["obstacles"][0]["motion"] = "in_place"
    waving = make_picture(event, observed.state(), 1, event.received)
    assert [tag.text for tag in waving.tags] == ["#7  in place"]


@pytest.mark.parametrize("tilt", [-0.2, 0.0, 0.3])
@pytest.mark.parametrize(("foot", "drawn"), [(0.1, 0.0), (0.6, 0.6), (-0.05, -0.05)])
def test_a_box_is_upright_around_the_body_for_any_camera_tilt(
    observed: Any, tilt: float, foot: float, drawn: float
) -> None:
    """A person of 1.7 m, seen from ``foot`` upwards; the part missing at the feet is added."""
    event = observed.observe()
    mount = CameraMount(0.9, tilt)
    T_world_display = level_pose(mount).inverse()
    height = 1.7 - foot
    event.line["obstacles"][0].update(
        position=T_world_display.apply([3.0, 0.4, foot + height / 2]).tolist(),
        size=[0.5, height, 0.4],
        orientation_wxyz=[1.0, 0.0, 0.0, 0.0],
    )
    state = replace(observed.state(), mount=mount)
    picture = make_picture(event, state, 1, event.received)
    edges = picture.T_display_world.apply(picture.boxes[0].reshape(-1, 3))
    np.testing.assert_allclose(edges.min(axis=0), [2.8, 0.15, drawn], atol=1e-9)
    np.testing.assert_allclose(edges.max(axis=0), [3.2, 0.65, 1.7], atol=1e-9)
    unknown = make_picture(event, replace(state, mount=None), 1, event.received)
    assert np.ptp(unknown.boxes[0].reshape(-1, 3)[:, 1]) == pytest.approx(height)


def test_old_data_are_marked_stale(observed: Any) -> None:
    event = observed.observe()
    state = observed.state()
    old = make_picture(event, state, 1, event.received + 3.2)
    assert old.stale
    paused = replace(state, playback=replace(state.playback, paused=True))
    held = make_picture(event, paused, 1, event.received + 3.2)
    assert not held.stale
    ended = replace(state, playback=replace(state.playback, ended=True))
    assert not make_picture(event, ended, 1, event.received + 3.2).stale
    failed = replace(paused, state=EngineState.FAILED)
    assert make_picture(event, failed, 1, event.received + 0.1).stale
    none = make_picture(None, state, 1, 5.0)
    assert not none.stale
    assert none.boxes.shape == (0, 12, 2, 3)


def test_objects_without_a_world_pose_are_not_drawn(observed: Any) -> None:
    event = observed.observe()
    event.line["pose"] = None
    for name in ("position", "velocity", "orientation_wxyz"):
        event.line["obstacles"][0][name] = None
    picture = make_picture(event, observed.state(), 1, event.received)
    assert picture.T_world_camera is None
    assert len(picture.boxes) == len(picture.arrows) == len(picture.tags) == 0


def test_clouds_are_read_back_as_written(observed: Any) -> None:
    observed.draw_cloud(40)
    value = observed.cloud.read(0)
    assert isinstance(value, Latest)
    cloud = read_cloud(value)
    assert cloud.points.shape == (40, 3)
    assert cloud.colors.shape == (40, 3)
    assert 1 <= cloud.points.min() <= cloud.points.max() <= 3
    np.testing.assert_allclose(cloud.T_world_camera.matrix, np.eye(4))
