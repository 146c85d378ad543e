"""EuRoC's ``sensor.yaml``: one file for each camera, composed to a stereo calibration."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from observer.calibration.formats.numbers import PinholeCamera, Transformation, array
from observer.calibration.formats.plain_data import (
    CALIBRATION,
    calibration_errors,
    parse_plain_data,
)
from observer.calibration.formats.understanding import Draft, check_alike
from observer.camera import DistortionModel, StereoCalibration
from observer.geometry import Float64Array
from observer.text_files import PlainData, one_of, read_text, validated

_DISTORTION_MODELS: Mapping[str, DistortionModel] = {
    "radial-tangential": "radtan",
    "radtan": "radtan",
    "equidistant": "equidistant",
}


@calibration_errors()
def read_euroc(left: Path, right: Path) -> StereoCalibration:
    """The calibration of two cameras from their ``sensor.yaml`` files.

    Raises:
        CalibrationError: one sentence naming the file, the key and the reason.
    """
    return _draft(_read_file(left), _read_file(right)).calibration()


def euroc_draft(
    first: tuple[str, dict[str, PlainData]], second: tuple[str, dict[str, PlainData]]
) -> Draft:
    """The calibration of two ``sensor.yaml`` files; ``T_BS`` tells which of them is left.

    Args:
        first, second: name and top-level mapping of each file.

    Raises:
        CalibrationError: one sentence naming the file, the key and the reason.
    """
    a, b = _read_camera(*first), _read_camera(*second)
    # The second camera's place as the first one sees it.
    beside = (a.T_BS.inverse() @ b.T_BS).translation[0]
    left, right = (a, b) if beside >= 0 else (b, a)
    return _draft(left, right, f"T_BS tells that {left.name} is the left camera")


class _Camera(PinholeCamera):
    name: str
    camera_model: Annotated[
        str,
        one_of({"pinhole": "pinhole"}, "must be pinhole, not {given}, which is not understood yet"),
    ] = "pinhole"
    distortion_model: Annotated[
        DistortionModel,
        one_of(
            _DISTORTION_MODELS,
            "must be radial-tangential or equidistant, not {given}, which is not understood yet",
        ),
    ] = "radtan"
    distortion_coefficients: Annotated[Float64Array, array(4)]
    T_BS: Transformation

    @property
    def model(self) -> DistortionModel:
        return self.distortion_model


def _draft(left: _Camera, right: _Camera, *notes: str) -> Draft:
    check_alike(
        left,
        right,
        name=right.name,
        size="resolution",
        model="distortion_model",
        other="the left camera's",
    )
    # T_BS maps a camera's coordinates into the body's.
    T_right_left = right.T_BS.inverse() @ left.T_BS
    return Draft(
        source=right.name,
        format="EuRoC sensor.yaml of two cameras",
        size=left.size,
        K1=left.K,
        D1=left.distortion_coefficients,
        K2=right.K,
        D2=right.distortion_coefficients,
        R=T_right_left.rotation,
        T=T_right_left.translation,
        distortion_model=left.model,
        keys={
            "K1": "intrinsics of the left camera",
            "D1": "distortion_coefficients of the left camera",
            "K2": "intrinsics",
            "D2": "distortion_coefficients",
        },
        derived={"T": "T_BS of both cameras"},
        notes=(*notes, "rotation and baseline composed of T_BS of both cameras"),
    )


def _read_file(path: Path) -> _Camera:
    name = f"{path.parent.name}/{path.name}"
    return _read_camera(name, parse_plain_data(read_text(path, CALIBRATION), name=name))


def _read_camera(name: str, data: dict[str, PlainData]) -> _Camera:
    return validated(_Camera, data | {"name": name}, name)
