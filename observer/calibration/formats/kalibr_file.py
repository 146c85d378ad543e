"""Kalibr's ``camchain.yaml``: a chain of cameras, of which the first two are the pair.

Format: Kalibr's wiki, "Yaml formats": ``T_cn_cnm1`` maps coordinates of the previous camera into
this camera's, metres; intrinsics are fx, fy, cx, cy.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field, PlainValidator, ValidationInfo

from observer.calibration.formats.numbers import PinholeCamera, Transformation, shaped
from observer.calibration.formats.understanding import Draft, DraftCamera, check_alike
from observer.geometry import Float64Array
from observer.text_files import FileModel, PlainData, one_of, validated


def _coefficients(value: PlainData, info: ValidationInfo) -> Float64Array:
    return np.zeros(4) if info.data.get("distortion_model") == "none" else shaped(value, 4)


class _Modelled(FileModel):
    """Checked before the keys of ``PinholeCamera``: other models have more intrinsics."""

    camera_model: Annotated[
        str,
        one_of(
            {"pinhole": "pinhole"},
            "must be pinhole, not {given}, which is not supported; calibrate fisheye lenses as "
            "pinhole-equi",
        ),
    ]


class _Camera(PinholeCamera, _Modelled):
    form = (
        "contain the keys camera_model, intrinsics, distortion_model, distortion_coeffs and "
        "resolution"
    )

    distortion_model: Annotated[
        str,
        one_of(
            {model: model for model in ("radtan", "none", "equidistant")},
            "is {given}, which is not supported; it must be radtan or equidistant",
        ),
    ]
    distortion_coeffs: Annotated[Float64Array, PlainValidator(_coefficients)] = Field(
        default=[], validate_default=True
    )

    def drafted(self, key: str) -> DraftCamera:
        return DraftCamera(
            self.resolution,
            self.K,
            self.distortion_coeffs,
            "equidistant" if self.distortion_model == "equidistant" else "radtan",
            f"{key}.intrinsics",
            f"{key}.distortion_coeffs",
        )


class _SecondCamera(_Camera):
    T_cn_cnm1: Transformation


class _Chain(FileModel):
    missing = (
        "is missing; calibrate both cameras together, so that the camchain contains cam0 and cam1"
    )

    cam0: _Camera
    cam1: _SecondCamera


def kalibr_draft(name: str, data: dict[str, PlainData]) -> Draft:
    """The calibration of ``cam0`` and ``cam1``; ``T_cn_cnm1`` tells which of them is left."""
    chain = validated(_Chain, data, name)
    left, right = chain.cam0.drafted("cam0"), chain.cam1.drafted("cam1")
    check_alike(
        left, right, name, size="cam1.resolution", model="cam1.distortion_model", other="cam0's"
    )
    notes = []
    T_right_left = chain.cam1.T_cn_cnm1
    if T_right_left.inverse().translation[0] < 0:
        left, right, T_right_left = right, left, T_right_left.inverse()
        notes.append("cam1 is to the left of cam0 (T_cn_cnm1), so cam1 is used as the left camera")
    further = [key for key in data if key.startswith("cam") and key not in ("cam0", "cam1")]
    if further:
        notes.append(f"cam0 and cam1 are used; {further[0][:20]} is ignored")
    return Draft(
        name,
        "Kalibr camchain",
        left,
        right,
        T_right_left.rotation,
        T_right_left.translation,
        R_key="cam1.T_cn_cnm1",
        T_key="cam1.T_cn_cnm1",
        notes=tuple(notes),
    )
