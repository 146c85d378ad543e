"""OAK's calib.json: choosing the pair, and the pose from links between sockets."""

from __future__ import annotations

import contextlib
import copy
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.calibration.formats.recognition import named_file, read_any
from observer.calibration.formats.understanding import NamedFile, UnderstoodCalibration
from observer.errors import CalibrationError
from observer.geometry import Pose
from observer.vision.rectification import Rectification

K1 = [[500.0, 0.0, 320.0], [0.0, 501.0, 240.0], [0.0, 0.0, 1.0]]
K2 = [[499.0, 0.0, 318.0], [0.0, 500.0, 241.0], [0.0, 0.0, 1.0]]
D = [-0.1, 0.02, 0.001, -0.002, 0.01, 0.03, 0.02, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
T_RIGHT_LEFT = Pose(
    np.asarray(cv2.Rodrigues(np.array([0.02, -0.03, 0.01]))[0], np.float64),
    np.array([-7.5, 0.3, -0.2]),
)
# From the right camera's frame into the colour camera's.
T_COLOUR_RIGHT = Pose.from_rotvec([0.01, 0.02, 0.03], [3.75, 0.1, -0.1])


def extrinsics(pose: Pose | None, to: int) -> dict[str, Any]:
    x, y, z = (0.0, 0.0, 0.0) if pose is None else pose.translation.tolist()
    rotation = np.zeros((3, 3)) if pose is None else pose.rotation
    return {
        "rotationMatrix": rotation.tolist(),
        "specTranslation": {"x": -7.5, "y": 0.0, "z": 0.0},
        "toCameraSocket": to,
        "translation": {"x": x, "y": y, "z": z},
    }


def camera(K: list[list[float]], link: dict[str, Any]) -> dict[str, Any]:
    return {
        "cameraType": 0, "distortionCoeff": D, "extrinsics": link, "height": 480,
        "intrinsicMatrix": K, "lensPosition": 0, "specHfovDeg": 71.86, "width": 640,
    }  # fmt: skip


def board(**links: dict[str, Any]) -> dict[str, Any]:
    made = {
        "left": extrinsics(T_RIGHT_LEFT, 2),
        "right": extrinsics(T_COLOUR_RIGHT, 0),
        "colour": extrinsics(None, -1),
    } | links
    return {
        "batchName": "", "boardName": "OAK-D", "version": 6,
        "cameraData": [
            [0, camera(K1, made["colour"]) | {"width": 1920, "height": 1080}],
            [1, camera(K1, made["left"])],
            [2, camera(K2, made["right"])],
        ],
        "stereoRectificationData": {"leftCameraSocket": 1, "rightCameraSocket": 2},
    }  # fmt: skip


def read(data: object) -> UnderstoodCalibration:
    return read_any([NamedFile("calib.json", json.dumps(data).encode())])


@pytest.mark.parametrize(
    "links",
    [
        {},
        {"left": extrinsics(None, -1), "right": extrinsics(T_RIGHT_LEFT.inverse(), 1)},
        {"left": extrinsics(T_COLOUR_RIGHT @ T_RIGHT_LEFT, 0)},
        # A cycle of links.
        {"colour": extrinsics((T_COLOUR_RIGHT @ T_RIGHT_LEFT).inverse(), 1)},
    ],
    ids=["left to right", "right to left", "both to colour", "in a circle"],
)
def test_pose_follows_the_links(links: dict[str, dict[str, Any]]) -> None:
    understood = read(board(**links))
    made = understood.calibration
    assert understood.format == "OAK calib.json (DepthAI)"
    assert np.allclose(made.R, T_RIGHT_LEFT.rotation, rtol=0, atol=1e-12)
    assert np.allclose(made.T, T_RIGHT_LEFT.translation / 100, rtol=0, atol=1e-12)
    assert made.K1.tolist() == K1
    assert made.K2.tolist() == K2
    assert made.D1.tolist() == D
    assert (made.width, made.height) == (640, 480)
    assert any("converted from centimetres: baseline 0.0750" in n for n in understood.notes)


def test_pose_maps_left_camera_points_into_the_right_camera() -> None:
    made = read(board()).calibration
    # A point straight ahead of the left camera lies further left for the right one.
    assert (made.R @ [0, 0, 3] + made.T)[0] == pytest.approx(
        T_RIGHT_LEFT.apply([0.0, 0.0, 300.0])[0] / 100
    )


def test_fisheye_lenses_are_read() -> None:
    data = board()
    for _, each in data["cameraData"]:
        each |= {"cameraType": 1, "distortionCoeff": [0.01, -0.02, 0.003, 0.001] + 10 * [0.0]}
    made = read(data).calibration
    assert made.distortion_model == "equidistant"
    assert made.D1.tolist() == [0.01, -0.02, 0.003, 0.001]
    data["cameraData"][1][1]["distortionCoeff"][7] = 1.0
    with pytest.raises(CalibrationError, match="of a fisheye camera must contain 4 coefficients"):
        read(data)


def test_file_from_a_real_device_is_read(shared_data: Path) -> None:
    folder = shared_data / "oak_people"
    understood = read_any([named_file(folder / "calib.json")])
    made = understood.calibration
    # The same cameras refitted with polynomial lenses, their pose unchanged.
    refit = read_any([named_file(folder / "calibration.yaml")]).calibration
    assert np.allclose(made.R, refit.R, rtol=0, atol=1e-6)
    assert np.allclose(made.T, refit.T, rtol=0, atol=1e-8)
    assert np.allclose(made.K1, refit.K1)
    assert np.allclose(made.K2, refit.K2)
    assert made.baseline == pytest.approx(0.0738, abs=1e-4)
    # Its lenses fold over within the image, so they are reported and replaced.
    assert sum("folds over" in note for note in understood.notes) == 2
    ours, theirs = Rectification(made).camera, Rectification(refit).camera
    assert ours.fx == pytest.approx(theirs.fx, rel=0.01)


def changed(*path: str | int, to: object) -> dict[str, Any]:
    data: Any = copy.deepcopy(board())
    at = data
    for key in path[:-1]:
        at = at[key]
    if to is None:
        del at[path[-1]]
    else:
        at[path[-1]] = to
    return dict(data)


LEFT = ("cameraData", 1, 1)


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (changed("stereoRectificationData", to=None), "stereoRectificationData is missing"),
        (changed("stereoRectificationData", "leftCameraSocket", to=-1),
         "stereoRectificationData.leftCameraSocket is -1, but cameraData has no such camera (it "
         "has 0, 1, 2)"),
        (changed("stereoRectificationData", "leftCameraSocket", to=2), "as both left and right"),
        (changed("stereoRectificationData", "leftCameraSocket", to="a"),
         "stereoRectificationData.leftCameraSocket must contain numbers only, not 'a'"),
        (changed("cameraData", to=[]), "cameraData has no such camera (it has none)"),
        (changed("cameraData", 1, to=[1]), "cameraData must contain pairs of [socket, camera]"),
        (changed("cameraData", 1, 0, to=0), "cameraData[0] is given twice"),
        (changed(*LEFT, to=[1]), "cameraData[1] must contain keys with values, not several"),
        (changed(*LEFT, "width", to=320), "cameraData[2] width x height is 640x480, but the left"),
        (changed(*LEFT, "width", to=None), "cameraData[1].width is missing"),
        (changed(*LEFT, "cameraType", to=3), "cameraData[1].cameraType must be 0 (perspective)"),
        (changed(*LEFT, "cameraType", to=1), "cameraData[1].distortionCoeff of a fisheye camera"),
        (changed(*LEFT, "intrinsicMatrix", to=[[1, 2]]),
         "cameraData[1].intrinsicMatrix must have shape 3 x 3, not 1 x 2"),
        (changed(*LEFT, "intrinsicMatrix", to=np.zeros((3, 3)).tolist()),
         "cameraData[1].intrinsicMatrix must be a camera matrix with positive focal"),
        (changed(*LEFT, "distortionCoeff", to=[1, 2]),
         "cameraData[1].distortionCoeff must contain 4, 5, 8, 12 or 14"),
        (changed(*LEFT, "distortionCoeff", 0, to=float("nan")), "must contain finite numbers only"),
        (changed(*LEFT, "extrinsics", to=None), "cameraData[1].extrinsics is missing"),
        (changed(*LEFT, "extrinsics", "translation", "x", to=None),
         "cameraData[1].extrinsics.translation.x is missing"),
        (changed(*LEFT, "extrinsics", "rotationMatrix", 0, 0, to=2),
         "cameraData[1].extrinsics.rotationMatrix must be a rotation matrix"),
        (board(left=extrinsics(None, -1)), "extrinsics do not connect"),
        (changed(*LEFT, "extrinsics", "translation", "x", to=7.5), "swap left and right"),
        (changed(*LEFT, "extrinsics", "translation", "x", to=-750),
         "when read in centimetres, which is outside"),
    ],
)  # fmt: skip
def test_refuses(data: dict[str, Any], expected: str) -> None:
    with pytest.raises(CalibrationError) as caught:
        read(data)
    message = str(caught.value)
    assert message.startswith("calib.json: ")
    assert expected in message
    assert "\n" not in message


WHOLE = json.dumps(board()).encode()


@given(
    part=st.floats(0, 1),
    length=st.integers(0, 60),
    put=st.binary(max_size=12)
    | st.sampled_from([b"1e308", b"-1e200", b"0", b"null", b"[", b"}", b"NaN", b'"a": 1,']),
)
@settings(max_examples=250)
def test_damaged_file_is_read_or_refused(part: float, length: int, put: bytes) -> None:
    at = int(part * len(WHOLE))
    with contextlib.suppress(CalibrationError):
        read_any([NamedFile("calib.json", WHOLE[:at] + put + WHOLE[at + length :])])


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-2, 2000) | st.floats() | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=8,
)
_PLACES = [
    ("cameraData",), ("cameraData", 1), ("cameraData", 1, 0), LEFT, ("stereoRectificationData",),
    ("stereoRectificationData", "leftCameraSocket"),
    *((*LEFT, key) for key in camera(K1, {})),
    *((*LEFT, "extrinsics", key) for key in extrinsics(None, -1)),
    (*LEFT, "extrinsics", "translation", "x"), (*LEFT, "distortionCoeff", 5),
]  # fmt: skip


@given(place=st.sampled_from(_PLACES), put=_JSON)
@settings(max_examples=250)
def test_arbitrary_values_in_any_field_are_read_or_refused(
    place: tuple[str | int, ...], put: Any
) -> None:
    with contextlib.suppress(CalibrationError):
        read(changed(*place, to=put))
