"""Calibrations written for other tools: OpenCV, ROS and Kalibr."""

from __future__ import annotations

from typing import Literal

import numpy as np

from observer.calibration.formats.opencv_file import calibration_text
from observer.calibration.formats.ros_file import ROS_MODELS
from observer.calibration.formats.understanding import NamedFile
from observer.camera import StereoCalibration
from observer.errors import CalibrationError
from observer.geometry import Float64Array, Pose
from observer.vision.rectification import Rectification

ExportKind = Literal["opencv", "ros", "kalibr"]


def export_calibration(
    calibration: StereoCalibration, kind: ExportKind, name: str
) -> tuple[NamedFile, ...]:
    """Return the calibration as files for another tool; ``read_any`` reads them back.

    Args:
        kind: ``opencv``: one FileStorage YAML. ``ros``: two camera_info files, rectified as we
            rectify. ``kalibr``: one camchain.
        name: what the calibration is called; becomes part of the files' names.

    Raises:
        CalibrationError: the other tool's format cannot express the calibration.
    """
    stem = "".join(c if c.isalnum() or c in "-_." else "_" for c in name).strip("._") or "stereo"
    if kind == "opencv":
        return (_file(f"{stem}.yaml", calibration_text(calibration)),)
    if kind == "kalibr":
        return (_file(f"{stem}-camchain.yaml", _camchain(calibration)),)
    left, right = _camera_infos(calibration)
    return _file(f"{stem}-left.yaml", left), _file(f"{stem}-right.yaml", right)


def _file(name: str, text: str) -> NamedFile:
    return NamedFile(name, text.encode("utf-8"))


def _camera_infos(calibration: StereoCalibration) -> tuple[str, str]:
    c, rectification = calibration, Rectification(calibration)
    camera = rectification.camera
    P1 = np.column_stack([camera.K, np.zeros(3)])
    P2 = P1.copy()
    P2[0, 3] = -camera.fb
    return (
        _camera_info(c, "left", c.K1, c.D1, "D1", rectification.R_rectified_left, P1),
        _camera_info(c, "right", c.K2, c.D2, "D2", rectification.R_rectified_right, P2),
    )


def _camera_info(
    calibration: StereoCalibration,
    side: str,
    K: Float64Array,
    D: Float64Array,
    key: str,
    R: Float64Array,
    P: Float64Array,
) -> str:
    if calibration.distortion_model == "equidistant":
        model = "equidistant"
    else:
        # plumb_bob always has five coefficients; OpenCV may leave out trailing zeros.
        D = np.concatenate([D, np.zeros(max(0, 5 - len(D)))])
        if len(D) > 8 and not D[8:].any():
            D = D[:8]
        if len(D) not in ROS_MODELS:
            raise CalibrationError(
                f"{key} holds {len(D)} distortion coefficients, but ROS supports only plumb_bob "
                "(5) and rational_polynomial (8); export for OpenCV, or calibrate with 5 or 8"
            )
        model = ROS_MODELS[len(D)]
    lines = [
        f"image_width: {calibration.width}",
        f"image_height: {calibration.height}",
        f"camera_name: {side}",
        *_matrix("camera_matrix", K),
        f"distortion_model: {model}",
        *_matrix("distortion_coefficients", D.reshape(1, -1)),
        *_matrix("rectification_matrix", R),
        *_matrix("projection_matrix", P),
    ]
    return "\n".join(lines) + "\n"


def _matrix(key: str, matrix: Float64Array) -> list[str]:
    rows, cols = matrix.shape
    return [f"{key}:", f"  rows: {rows}", f"  cols: {cols}", f"  data: {_list(matrix)}"]


def _camchain(calibration: StereoCalibration) -> str:
    T_right_left = Pose(calibration.R, calibration.T).matrix
    lines = [*_chain_link(calibration, "cam0", calibration.K1, calibration.D1, "D1")]
    lines += _chain_link(calibration, "cam1", calibration.K2, calibration.D2, "D2")
    lines.append("  T_cn_cnm1:")
    lines += [f"  - {_list(row)}" for row in T_right_left]
    return "\n".join(lines) + "\n"


def _chain_link(
    calibration: StereoCalibration, camera: str, K: Float64Array, D: Float64Array, key: str
) -> list[str]:
    coefficients = np.concatenate([D, np.zeros(max(0, 4 - len(D)))])
    if coefficients[4:].any():
        raise CalibrationError(
            f"{key} has k3 = {coefficients[4]:.4g} and {len(D)} coefficients, but Kalibr's radtan "
            "supports only k1, k2, p1 and p2; export for OpenCV or ROS, or calibrate with these "
            "four"
        )
    return [
        f"{camera}:",
        "  camera_model: pinhole",
        f"  intrinsics: {_list(np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]]))}",
        f"  distortion_model: {calibration.distortion_model}",
        f"  distortion_coeffs: {_list(coefficients[:4])}",
        f"  resolution: [{calibration.width}, {calibration.height}]",
        f"  rostopic: /{camera}/image_raw",
    ]


def _list(values: Float64Array) -> str:
    return f"[{', '.join(repr(float(value)) for value in values.ravel())}]"
