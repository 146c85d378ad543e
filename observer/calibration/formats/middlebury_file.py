"""Middlebury's ``calib.txt`` (stereo data sets since 2014): a rectified pair, millimetres.

Z = baseline f / (d + doffs): the two cameras' principal points are doffs pixels apart, as their
matrices cam0 and cam1 also show.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import PlainValidator

from observer.calibration.formats.numbers import WholeNumber, array, finite_numbers
from observer.calibration.formats.understanding import Draft, DraftCamera
from observer.errors import CalibrationError
from observer.geometry import Float64Array
from observer.text_files import FileModel, PlainData, validated

# The files give three decimals.
_DOFFS_TOLERANCE_PX = 0.01


def _camera_matrix(value: PlainData) -> Float64Array:
    text = str(value).strip()
    if not (text.startswith("[") and text.endswith("]")):
        raise ValueError("must be a matrix [fx 0 cx; 0 fy cy; 0 0 1]")
    rows = [finite_numbers(row) for row in text[1:-1].split(";")]
    if len(rows) != 3:
        raise ValueError(f"must have three rows, not {len(rows)}")
    if any(row.size != 3 for row in rows):
        raise ValueError("must have three numbers in each row")
    return np.stack(rows)


class _Calibration(FileModel):
    cam0: Annotated[Float64Array, PlainValidator(_camera_matrix)]
    cam1: Annotated[Float64Array, PlainValidator(_camera_matrix)]
    baseline: Annotated[Float64Array, array(1)]
    doffs: Annotated[Float64Array, array(1)] | None = None
    width: WholeNumber
    height: WholeNumber


def middlebury_draft(name: str, text: str) -> Draft:
    """The calibration of a ``calib.txt``."""
    entries = (line.partition("=") for line in text.splitlines())
    data = {key.strip(): value for key, equal, value in entries if equal}
    read = validated(_Calibration, data, name)
    notes = ["the images are already rectified"]
    apart = read.cam1[0, 2] - read.cam0[0, 2]
    if read.doffs is not None:
        doffs = float(read.doffs[0])
        if abs(doffs - apart) > _DOFFS_TOLERANCE_PX:
            raise CalibrationError(
                f"{name}: doffs is {doffs:g}, but the principal points of cam0 and cam1 are "
                f"{apart:g} pixels apart; both must be the same"
            )
    if apart:
        notes.append(f"the principal points are {apart:g} px apart (doffs), which is compensated")
    size = read.width, read.height
    return Draft(
        name,
        "Middlebury calib.txt",
        DraftCamera(size, read.cam0, np.zeros(5), K_key="cam0"),
        DraftCamera(size, read.cam1, np.zeros(5), K_key="cam1"),
        np.eye(3),
        np.array([-float(read.baseline[0]), 0.0, 0.0]),
        unit="mm",
        T_key="baseline",
        notes=tuple(notes),
    )
