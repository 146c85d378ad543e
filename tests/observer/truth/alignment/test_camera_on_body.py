"""The camera on its body, as entered by the user."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.errors import TruthError
from observer.mount import CameraMount
from observer.truth.alignment.alignment import align
from observer.truth.alignment.camera_on_body import CameraOnBody
from observer.truth.alignment.choices import AlignmentChoices
from observer.truth.alignment.observed import ObservedRun

metres = st.floats(-10, 10)


places = st.builds(
    CameraOnBody, metres, metres, metres, st.floats(-179, 179), st.floats(-85, 85),
    st.floats(-179, 179),
)  # fmt: skip


@given(places)
def test_pose_and_text_hold_the_same_six_numbers(place: CameraOnBody) -> None:
    assert CameraOnBody.parse(str(place)) == place
    again = CameraOnBody.of_pose(place.T_body_camera)
    np.testing.assert_allclose(again.T_body_camera.matrix, place.T_body_camera.matrix, atol=1e-9)
    assert again.tilt_deg == pytest.approx(place.tilt_deg, abs=1e-6)
    assert again.pan_deg == pytest.approx(place.pan_deg, abs=1e-6)


def test_placement_equals_the_mount_when_the_body_is_the_robot_base() -> None:
    mount = CameraMount(0.4, np.radians(8), 0.1, 0.05, np.radians(-3), np.radians(20))
    place = CameraOnBody(0.1, 0.05, 0.4, 20, 8, -3)
    np.testing.assert_allclose(place.T_body_camera.matrix, mount.T_base_camera.matrix, atol=1e-12)
    assert CameraOnBody.of_pose(mount.T_base_camera).pan_deg == pytest.approx(20)


def test_level_camera_looks_along_x() -> None:
    level = CameraOnBody(0, 0, 0, 0, 0, 0).T_body_camera
    np.testing.assert_allclose(level.rotate([[0, 0, 1], [1, 0, 0]]), [[1, 0, 0], [0, -1, 0]])
    down = CameraOnBody(0, 0, 0, 0, 10, 0).T_body_camera
    assert down.rotate([0, 0, 1])[2] == pytest.approx(-np.sin(np.radians(10)))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "X,Y,Z,PAN,TILT,ROLL"),
        ("0.1,0.2,0.3", "X,Y,Z,PAN,TILT,ROLL"),
        ("0.1,0.2,0.3,0,10,up", "X,Y,Z,PAN,TILT,ROLL"),
        ("120,0,250,0,0,0", "x_m of the camera on its body must be between -10 and 10, not 120"),
        ("0,0,0,0,91,0", "tilt_deg of the camera on its body must be between -90 and 90, not 91"),
        ("0,0,nan,0,0,0", "z_m of the camera on its body must be between -10 and 10, not nan"),
    ],
)
def test_invalid_placement_is_refused(text: str, sentence: str) -> None:
    with pytest.raises(TruthError, match=sentence):
        CameraOnBody.parse(text)


def test_typed_placement_is_used_for_the_room_pose(rooms: Any) -> None:
    room = rooms(1)
    typed = CameraOnBody.of_pose(room.T_body_camera).T_body_camera
    choices = AlignmentChoices(roles={"Amigo": "observer"}, T_body_camera=typed)
    found = align(ObservedRun.of_lines(room.lines), room.capture, choices)
    assert found.T_body_camera is not None
    # Including its height, which motion on a floor does not determine.
    np.testing.assert_allclose(found.T_body_camera.matrix, typed.matrix, atol=0.02)
    apart = found.T_world_room[0].inverse() @ room.T_world_room
    assert np.linalg.norm(apart.translation) < 0.05
    assert any("the given value" in note for note in found.notes)
    assert not any("level" in note for note in found.notes)
