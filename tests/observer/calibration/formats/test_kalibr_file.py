"""Kalibr camchains: both lens models, both camera orders, and refusals."""

from __future__ import annotations

import re

import cv2
import numpy as np
import pytest

from observer.calibration.formats.recognition import read_any
from observer.calibration.formats.understanding import NamedFile, UnderstoodCalibration
from observer.errors import CalibrationError

R = cv2.Rodrigues(np.array([0.02, -0.03, 0.01]))[0]
T = np.array([-0.12, 0.003, -0.002])


def chain(model: str = "radtan", R: np.ndarray = R, T: np.ndarray = T) -> str:
    rows = [[*row, t] for row, t in zip(R.tolist(), T.tolist(), strict=True)]
    pose = "\n".join(f"  - {row}" for row in [*rows, [0.0, 0.0, 0.0, 1.0]])
    return (
        "cam0:\n  cam_overlaps: [1]\n  camera_model: pinhole\n"
        f"  distortion_coeffs: [0.1, -0.2, 0.003, 0.0004]\n  distortion_model: {model}\n"
        "  intrinsics: [460.0, 461.0, 370.0, 240.0]\n  resolution: [752, 480]\n"
        "  rostopic: /cam0/image_raw\n"
        "cam1:\n  T_cn_cnm1:\n" + pose + "\n  cam_overlaps: [0]\n  camera_model: pinhole\n"
        f"  distortion_coeffs: [0.11, -0.21, 0.0, 0.0]\n  distortion_model: {model}\n"
        "  intrinsics: [462.0, 463.0, 371.0, 241.0]\n  resolution: [752, 480]\n"
        "  rostopic: /cam1/image_raw\n"
    )


def read(text: str) -> UnderstoodCalibration:
    return read_any([NamedFile("chain.yaml", text.encode())])


@pytest.mark.parametrize("model", ["radtan", "equidistant"])
def test_reads_a_camchain(model: str) -> None:
    understood = read(chain(model))
    made = understood.calibration
    assert made.distortion_model == model
    assert np.array_equal(made.K1, [[460, 0, 370], [0, 461, 240], [0, 0, 1]])
    assert np.array_equal(made.K2, [[462, 0, 371], [0, 463, 241], [0, 0, 1]])
    assert made.D1.tolist() == [0.1, -0.2, 0.003, 0.0004]
    assert np.allclose(made.R, R, rtol=0, atol=1e-12)
    assert np.allclose(made.T, T, rtol=0, atol=1e-12)
    assert (made.width, made.height) == (752, 480)
    assert understood.format == "Kalibr camchain"
    assert understood.notes == ("cam1.T_cn_cnm1 read in metres: baseline 0.12005 m",)


def test_cam1_becomes_the_left_camera_when_left_of_cam0() -> None:
    understood = read(chain(R=R.T, T=-R.T @ T))
    made = understood.calibration
    assert np.allclose(made.R, R, rtol=0, atol=1e-12)
    assert np.allclose(made.T, T, rtol=0, atol=1e-12)
    assert made.K1[0, 0] == 462
    assert made.D1[0] == 0.11
    assert (
        "cam1 is to the left of cam0 (T_cn_cnm1), so cam1 is used as the left camera"
        in understood.notes
    )


def test_additional_cameras_are_ignored_with_a_note() -> None:
    understood = read(chain() + "cam2: {camera_model: omni}\n")
    assert "cam0 and cam1 are used; cam2 is ignored" in understood.notes


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("cam1:", "cam7:", "cam1 is missing; calibrate both cameras together"),
        ("cam0:\n  cam_overlaps: [1]\n  camera_model: pinhole",
         "cam0:\n  camera_model: omni", "cam0.camera_model must be pinhole, not 'omni'"),
        ("  camera_model: pinhole\n  distortion_coeffs: [0.11", "  distortion_coeffs: [0.11",
         "cam1.camera_model is missing"),
        ("distortion_model: radtan", "distortion_model: fov", "cam0.distortion_model is 'fov'"),
        ("distortion_model: radtan", "x: radtan", "cam0.distortion_model is missing"),
        ("distortion_coeffs: [0.11, ", "distortion_coeffs: [",
         "cam1.distortion_coeffs must contain 4 numbers, not 3"),
        ("[462.0, 463.0", "[462.0, .nan", "cam1.intrinsics must contain finite numbers only"),
        ("[462.0, 463.0", "[-462.0, 463.0", "cam1.intrinsics must be a camera matrix with positi"),
        ("resolution: [752, 480]\n  rostopic: /cam1", "resolution: [640, 480]\n  rostopic: /cam1",
         "cam1.resolution is 640x480, but cam0's is 752x480"),
        ("resolution: [752, 480]", "resolution: [752.5, 480]", "cam0.resolution must contain two"),
        ("  - [0.0, 0.0, 0.0, 1.0]", "", "cam1.T_cn_cnm1 must have shape 4 x 4, not 3 x 4"),
        ("  - [0.0, 0.0, 0.0, 1.0]", "  - [0.0, 0.0, 1.0, 1.0]",
         "cam1.T_cn_cnm1 must contain a rotation"),
        ("[0.0, 0.0, 0.0, 1.0]", "&a [0.0, 0.0, 0.0, 1.0]", "line 14 uses a YAML alias"),
        ("cam1:", "cam1: 3\nx:", "cam1 must contain the keys camera_model, intrinsics"),
    ],
)  # fmt: skip
def test_refuses(old: str, new: str, expected: str) -> None:
    text = chain()
    assert old in text
    with pytest.raises(CalibrationError) as caught:
        read(text.replace(old, new, 1))
    assert str(caught.value).startswith("chain.yaml: ")
    assert expected in str(caught.value)


@pytest.mark.parametrize(
    ("chained", "expected"),
    [
        (chain(R=1.5 * R), "cam1.T_cn_cnm1 must contain a rotation"),
        (chain(T=0 * T), "cam1.T_cn_cnm1 must not be zero"),
        (
            chain(T=1000 * T),
            "cam1.T_cn_cnm1 gives a baseline of 120.054 m when read in metres, which is outside",
        ),
        (chain(T=np.array([0, -0.12, 0])), "cam1.T_cn_cnm1 places the right camera"),
        (chain().replace("radtan", "equidistant", 1), "cam1.distortion_model is radtan, but cam0"),
    ],
)
def test_refuses_invalid_poses_and_pairs(chained: str, expected: str) -> None:
    with pytest.raises(CalibrationError) as caught:
        read(chained)
    assert expected in str(caught.value)


def test_a_model_with_more_intrinsics_is_named() -> None:
    text = re.sub(r"intrinsics: \[", "intrinsics: [1.2, ", chain()).replace("pinhole", "omni")
    with pytest.raises(CalibrationError, match="must be pinhole, not 'omni'"):
        read_any([NamedFile("camchain.yaml", text.encode())])
