"""Kalibr's ``camchain.yaml``: a chain of cameras, of which the first two are the pair.

Format: Kalibr's wiki, "Yaml formats": ``T_cn_cnm1`` maps coordinates of the camera before into
this camera's, metres; intrinsics are fx, fy, cx, cy.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from observer.calibration.formats.numbers import image_size, shaped_numbers, transformation
from observer.calibration.formats.plain_data import PlainData
from observer.calibration.formats.understanding import Draft, FileCamera, check_alike
from observer.camera import DistortionModel
from observer.errors import CalibrationError

_DISTORTION_MODELS: Mapping[str, DistortionModel] = {
    "radtan": "radtan",
    "none": "radtan",
    "equidistant": "equidistant",
}


@dataclass(frozen=True, eq=False)
class _Camera(FileCamera):
    key: str


def kalibr_draft(name: str, data: dict[str, PlainData]) -> Draft:
    """The calibration of ``cam0`` and ``cam1``; ``T_cn_cnm1`` tells which of them is left.

    Raises:
        CalibrationError: one sentence naming the file, the key and the reason.
    """
    if "cam1" not in data:
        raise CalibrationError(
            f"{name}: cam1 is missing; calibrate both cameras together, so that the camchain "
            f"holds cam0 and cam1"
        )
    cam0, cam1 = (_read_camera(name, data, key) for key in ("cam0", "cam1"))
    check_alike(
        cam0,
        cam1,
        name=name,
        size="cam1.resolution",
        model="cam1.distortion_model",
        other="cam0's",
    )
    T_cam1_cam0 = transformation(
        _mapping(name, data, "cam1"), "T_cn_cnm1", name=name, label="cam1.T_cn_cnm1"
    )
    notes = []
    left, right, T_right_left = cam0, cam1, T_cam1_cam0
    if T_cam1_cam0.inverse().translation[0] < 0:
        left, right, T_right_left = cam1, cam0, T_cam1_cam0.inverse()
        notes.append("cam1 stands to the left of cam0 (T_cn_cnm1): cam1 is taken as left")
    further = [key for key in data if key.startswith("cam") and key not in ("cam0", "cam1")]
    if further:
        notes.append(f"of the cameras of this file cam0 and cam1 are used, not {further[0][:20]}")
    return Draft(
        source=name,
        format="Kalibr camchain",
        size=left.size,
        K1=left.K,
        D1=left.D,
        K2=right.K,
        D2=right.D,
        R=T_right_left.rotation,
        T=T_right_left.translation,
        distortion_model=left.model,
        keys={
            "K1": f"{left.key}.intrinsics",
            "D1": f"{left.key}.distortion_coeffs",
            "K2": f"{right.key}.intrinsics",
            "D2": f"{right.key}.distortion_coeffs",
            "R": "cam1.T_cn_cnm1",
            "T": "cam1.T_cn_cnm1",
        },
        notes=tuple(notes),
    )


def _mapping(name: str, data: dict[str, PlainData], key: str) -> dict[str, PlainData]:
    value = data.get(key)
    if not isinstance(value, dict):
        raise CalibrationError(
            f"{name}: {key} must hold the keys camera_model, intrinsics, distortion_model, "
            f"distortion_coeffs and resolution"
        )
    return value


def _read_camera(name: str, data: dict[str, PlainData], key: str) -> _Camera:
    camera = _mapping(name, data, key)
    if "camera_model" not in camera:
        raise CalibrationError(f"{name}: {key}.camera_model is missing")
    if camera["camera_model"] != "pinhole":
        raise CalibrationError(
            f"{name}: {key}.camera_model must be pinhole, not "
            f"{str(camera['camera_model'])[:40]!r}, which is not supported; calibrate fisheye "
            f"lenses as pinhole-equi"
        )
    model = camera.get("distortion_model")
    if not isinstance(model, str) or model not in _DISTORTION_MODELS:
        given = "missing" if model is None else f"{str(model)[:40]!r}, which is not supported"
        raise CalibrationError(
            f"{name}: {key}.distortion_model is {given}; it must be radtan or equidistant"
        )
    fx, fy, cx, cy = shaped_numbers(
        camera, "intrinsics", (4,), name=name, label=f"{key}.intrinsics"
    )
    D = (
        np.zeros(4)
        if model == "none"
        else shaped_numbers(
            camera, "distortion_coeffs", (4,), name=name, label=f"{key}.distortion_coeffs"
        )
    )
    return _Camera(
        key=key,
        size=image_size(camera, "resolution", name=name, label=f"{key}.resolution"),
        K=np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]),
        D=D,
        model=_DISTORTION_MODELS[model],
    )
