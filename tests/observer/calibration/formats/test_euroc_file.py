"""EuRoC's sensor.yaml pairs: composing T_BS of both cameras, and identifying left and right."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from observer.calibration.formats.recognition import read_any
from observer.calibration.formats.understanding import NamedFile
from observer.errors import CalibrationError
from observer.geometry import Pose

# Arbitrary pose in the body; the right camera is 0.11 m beside the left, rotated by 2 degrees.
T_BODY_LEFT = Pose(Rotation.from_rotvec([0.1, 1.2, -0.4]).as_matrix(), np.array([0.3, -0.2, 0.1]))
T_RIGHT_LEFT = Pose(
    Rotation.from_rotvec([0.02, -0.03, 0.01]).as_matrix(), np.array([-0.11, 0.002, 0.003])
)
T_BODY_RIGHT = T_BODY_LEFT @ T_RIGHT_LEFT.inverse()


def sensor(T_BS: Pose, fx: float, model: str = "radial-tangential", size: str = "752, 480") -> str:
    numbers = ", ".join(map(repr, T_BS.matrix.ravel().tolist()))
    return (
        "#Default imu sensor yaml file\nsensor_type: camera\n"
        f"T_BS:\n  cols: 4\n  rows: 4\n  data: [{numbers}]\nrate_hz: 20\n"
        f"resolution: [{size}]\ncamera_model: pinhole\nintrinsics: [{fx}, 457.2, 367.2, 248.3]\n"
        f"distortion_model: {model}\n"
        "distortion_coefficients: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]\n"
    )


LEFT, RIGHT = sensor(T_BODY_LEFT, 458.0), sensor(T_BODY_RIGHT, 459.0)


@pytest.mark.parametrize("order", [1, -1])
def test_pose_is_composed_and_identifies_left_and_right(order: int) -> None:
    # EuRoC gives both files the same name.
    files = [NamedFile("sensor.yaml", text.encode()) for text in (LEFT, RIGHT)][::order]
    read = read_any(files)
    made = read.calibration
    assert np.allclose(made.R, T_RIGHT_LEFT.rotation, rtol=0, atol=1e-12)
    assert np.allclose(made.T, T_RIGHT_LEFT.translation, rtol=0, atol=1e-12)
    assert made.K1[0, 0] == 458
    assert made.K2[0, 0] == 459
    assert (made.width, made.height) == (752, 480)
    number = 1 if order == 1 else 2
    assert f"according to T_BS, sensor.yaml ({number}) is the left camera" in read.notes


def test_fisheye_lenses_are_read() -> None:
    texts = [sensor(T, 458.0, "equidistant") for T in (T_BODY_LEFT, T_BODY_RIGHT)]
    files = [NamedFile(f"cam{i}.yaml", text.encode()) for i, text in enumerate(texts)]
    assert read_any(files).calibration.distortion_model == "equidistant"


@pytest.mark.parametrize(
    ("right", "expected"),
    [
        (sensor(T_BODY_RIGHT, 459, size="640, 480"), "resolution is 640x480, but the left"),
        (sensor(T_BODY_RIGHT, 459, "equidistant"), "distortion_model is equidistant, but the left"),
        (sensor(T_BODY_RIGHT, 459, "fov"), "distortion_model must be radial-tangential or equi"),
        (sensor(T_BODY_LEFT, 459), "T must not be zero.*T is derived from T_BS of both cameras"),
        (sensor(T_BODY_RIGHT, -459), "intrinsics must be a camera matrix"),
        (RIGHT.replace("T_BS", "T_SB"), "T_BS is missing"),
        (RIGHT.replace("camera_model: pinhole", "camera_model: omni"), "camera_model must be pin"),
        (RIGHT.replace("0.0, 1.0]", "1.0, 1.0]"), "T_BS must contain a rotation"),
    ],
)
def test_refuses(right: str, expected: str) -> None:
    files = [NamedFile("a.yaml", LEFT.encode()), NamedFile("b.yaml", right.encode())]
    with pytest.raises(CalibrationError, match=rf"^b\.yaml: .*{expected}"):
        read_any(files)


def test_one_camera_is_not_enough() -> None:
    with pytest.raises(CalibrationError, match="contains one camera; supply both files together"):
        read_any([NamedFile("sensor.yaml", LEFT.encode())])
