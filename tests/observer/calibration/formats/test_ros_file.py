"""ROS camera_info pairs: the pose between the cameras from two rectifications."""

from __future__ import annotations

import re
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from observer.calibration.formats.recognition import read_any
from observer.calibration.formats.understanding import NamedFile
from observer.errors import CalibrationError

SIZE = (640, 480)
K = {"left": np.array([[500.0, 0, 320], [0, 501, 240], [0, 0, 1]]),
     "right": np.array([[499.0, 0, 318], [0, 500, 241], [0, 0, 1]])}  # fmt: skip
D = {"left": [0.1, -0.2, 0.001, 0.002, 0.05], "right": [0.11, -0.21, 0.0, 0.0, 0.0]}
R = cv2.Rodrigues(np.array([0.02, -0.03, 0.01]))[0]
T = np.array([-0.12, 0.003, -0.002])


def matrix(key: str, values: Any, rows: int) -> str:
    numbers = np.ravel(values)
    return (
        f"{key}:\n  rows: {rows}\n  cols: {len(numbers) // rows}\n"
        f"  data: [{', '.join(repr(float(v)) for v in numbers)}]\n"
    )


def camera_info(
    side: str, model: str = "plumb_bob", D: npt.ArrayLike | None = None, **changes: object
) -> str:
    """Return a camera_calibration file, with OpenCV's own rectification of the pair."""
    both = cv2.stereoRectify(
        K["left"], np.zeros(5), K["right"], np.zeros(5), SIZE, R, T.reshape(3, 1)
    )
    values: dict[str, Any] = {
        "R": both[0 if side == "left" else 1],
        "P": both[2 if side == "left" else 3],
    }
    values |= {"K": K[side], "width": SIZE[0], "name": f"narrow_stereo/{side}"} | changes
    D = globals()["D"][side] if D is None else D
    return (
        f"image_width: {values['width']}\nimage_height: {SIZE[1]}\n"
        f"camera_name: {values['name']}\n"
        + matrix("camera_matrix", values["K"], 3)
        + f"distortion_model: {model}\n"
        + matrix("distortion_coefficients", D, 1)
        + matrix("rectification_matrix", values["R"], 3)
        + matrix("projection_matrix", values["P"], 3)
    )


def files(
    left: str, right: str, names: tuple[str, str] = ("left.yaml", "right.yaml")
) -> list[NamedFile]:
    texts = zip(names, (left, right), strict=True)
    return [NamedFile(name, text.encode()) for name, text in texts]


@pytest.mark.parametrize("order", [1, -1])
def test_pose_follows_from_both_rectifications(order: int) -> None:
    read = read_any(files(camera_info("left"), camera_info("right"))[::order])
    made = read.calibration
    assert np.allclose(made.R, R, rtol=0, atol=1e-12)
    # The baseline alone would give (-0.12, 0, 0): T must be rotated by the rectification.
    assert np.allclose(made.T, T, rtol=0, atol=1e-12)
    assert np.array_equal(made.K1, K["left"])
    assert np.array_equal(made.K2, K["right"])
    assert made.D1.tolist() == D["left"]
    assert made.D2.tolist() == D["right"]
    assert (made.width, made.height) == SIZE
    assert read.format == "ROS camera_info of two cameras"
    assert "left.yaml is the left camera (projection_matrix)" in read.notes


def test_projection_overrides_names_in_identifying_left_and_right() -> None:
    read = read_any(files(
        camera_info("left", name="cam"), camera_info("right", name="cam"), ("right.yaml", "b.yaml")
    ))  # fmt: skip
    assert np.allclose(read.calibration.T, T, rtol=0, atol=1e-12)
    assert (
        "right.yaml is the left camera (projection_matrix), although the file names suggest "
        "otherwise" in read.notes
    )


@pytest.mark.parametrize(
    ("model", "coefficients", "understood"),
    [
        ("rational_polynomial", np.linspace(0.01, 0.08, 8), "radtan"),
        ("equidistant", [0.01, -0.02, 0.003, -0.0004], "equidistant"),
        ("plumb_bob", [0.1, 0.2, 0, 0], "radtan"),
    ],
)
def test_lens_models_are_read(model: str, coefficients: npt.ArrayLike, understood: str) -> None:
    left, right = (camera_info(side, model, coefficients) for side in ("left", "right"))
    pair = files(left, right)
    made = read_any(pair).calibration
    assert made.distortion_model == understood
    assert np.allclose(made.D1, np.array(coefficients), rtol=0, atol=1e-12)


GOOD = {side: camera_info(side) for side in ("left", "right")}


@pytest.mark.parametrize(
    ("left", "right", "expected"),
    [
        (GOOD["left"], GOOD["left"], r"projection_matrix has the same offset P\[3\]"),
        (GOOD["left"], camera_info("right", width=320), "image_width x image_height is 320x480"),
        (GOOD["left"], camera_info("right", "equidistant", [0, 0, 0, 0.1]),
         "distortion_model is equidistant, but the left camera's is radtan"),
        (GOOD["left"], camera_info("right", "thin_prism"), "distortion_model must be plumb_bob"),
        (GOOD["left"], camera_info("right", D=[1, 2, 3]), "D2|distortion_coefficients must con"),
        (GOOD["left"], camera_info("right", K=np.zeros((3, 3))), "camera_matrix is zero"),
        (GOOD["left"], camera_info("right", R=2 * np.eye(3)), "rectification_matrix must be a rot"),
        (GOOD["left"], camera_info("right", P=np.zeros((3, 4))), "projection_matrix must have a"),
        (GOOD["left"], camera_info("right", P=np.full((3, 4), np.inf)),
         "projection_matrix must contain finite numbers only"),
        (GOOD["left"], GOOD["right"].replace("rectification_matrix", "r"), "rectification_matrix "
         "is missing"),
        (GOOD["left"], GOOD["right"].replace("image_height", "h"), "image_height is missing"),
        (GOOD["left"], GOOD["right"].replace("rows: 3\n  cols: 4", "rows: 4\n  cols: 3"),
         "projection_matrix must have shape 3 x 4, not 4 x 3"),
    ],
)  # fmt: skip
def test_refuses(left: str, right: str, expected: str) -> None:
    with pytest.raises(CalibrationError, match=rf"^right\.yaml: .*{expected}"):
        read_any(files(left, right))


def test_one_camera_is_not_enough() -> None:
    with pytest.raises(
        CalibrationError, match=r"left\.yaml: a ROS camera_info contains one camera"
    ):
        read_any([NamedFile("left.yaml", GOOD["left"].encode())])


@pytest.mark.parametrize("is_lower", [True, False])
def test_printed_messages_are_read(is_lower: bool) -> None:
    """As ``ros2 topic echo --once`` prints them, and ``rostopic echo -n1`` with capital letters."""
    names = {
        "image_width": "width", "image_height": "height", "camera_matrix": "K",
        "distortion_coefficients": "D", "rectification_matrix": "R", "projection_matrix": "P",
    }  # fmt: skip

    def printed(side: str) -> str:
        text = re.sub(r"  (rows|cols): .*\n", "", camera_info(side)).replace(":\n  data: ", ": ")
        for key, name in names.items():
            text = text.replace(f"{key}:", f"{name.lower() if is_lower else name}:")
        text = text.replace("camera_name", "header:\n  frame_id")
        return f"{text}roi:\n  x_offset: 0\n  height: 0\n  width: 0\n---\n"

    read = read_any(files(printed("left"), printed("right"))).calibration
    expected = read_any(files(camera_info("left"), camera_info("right"))).calibration
    for key in ("K1", "D1", "K2", "D2", "R", "T"):
        np.testing.assert_array_equal(getattr(read, key), getattr(expected, key))
