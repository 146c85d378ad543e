"""EuRoC's ``sensor.yaml``: one file for each camera, combined into a stereo calibration."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from observer.calibration.formats.numbers import PinholeCamera, Transformation, array
from observer.calibration.formats.plain_data import (
    CALIBRATION,
    NamedData,
    calibration_errors,
    parse_plain_data,
)
from observer.calibration.formats.understanding import Draft, DraftCamera, check_alike
from observer.camera import DistortionModel, StereoCalibration
from observer.geometry import Float64Array
from observer.text_files import PlainData, one_of, read_text, validated


@calibration_errors()
def read_euroc(left: Path, right: Path) -> StereoCalibration:
    """The calibration of two cameras from their ``sensor.yaml`` files."""
    return _draft(_read_file(left), _read_file(right)).calibration()


def euroc_draft(first: NamedData, second: NamedData) -> Draft:
    """The calibration of two ``sensor.yaml`` files; ``T_BS`` tells which of them is left."""
    a, b = _read_camera(*first), _read_camera(*second)
    # The second camera's position in the first one's frame.
    beside = (a.T_BS.inverse() @ b.T_BS).translation[0]
    left, right = (a, b) if beside >= 0 else (b, a)
    return _draft(left, right, f"according to T_BS, {left.name} is the left camera")


class _Camera(PinholeCamera):
    name: str
    camera_model: Annotated[
        str,
        one_of({"pinhole": "pinhole"}, "must be pinhole, not {given}, which is not supported"),
    ] = "pinhole"
    distortion_model: Annotated[
        DistortionModel,
        one_of(
            {"radial-tangential": "radtan", "radtan": "radtan", "equidistant": "equidistant"},
            "must be radial-tangential or equidistant, not {given}, which is not supported",
        ),
    ] = "radtan"
    distortion_coefficients: Annotated[Float64Array, array(4)]
    T_BS: Transformation

    def drafted(self, whose: str) -> DraftCamera:
        return DraftCamera(
            self.resolution,
            self.K,
            self.distortion_coefficients,
            self.distortion_model,
            f"intrinsics{whose}",
            f"distortion_coefficients{whose}",
        )


def _draft(left: _Camera, right: _Camera, *notes: str) -> Draft:
    cameras = left.drafted(" of the left camera"), right.drafted("")
    check_alike(*cameras, right.name)
    # T_BS maps a camera's coordinates into the body's.
    T_right_left = right.T_BS.inverse() @ left.T_BS
    return Draft(
        right.name,
        "EuRoC sensor.yaml of two cameras",
        *cameras,
        T_right_left.rotation,
        T_right_left.translation,
        derived={"T": "T_BS of both cameras"},
        notes=(*notes, "rotation and baseline composed of T_BS of both cameras"),
    )


def _read_file(path: Path) -> _Camera:
    name = f"{path.parent.name}/{path.name}"
    return _read_camera(name, parse_plain_data(read_text(path, CALIBRATION), name=name))


def _read_camera(name: str, data: dict[str, PlainData]) -> _Camera:
    return validated(_Camera, data | {"name": name}, name)
