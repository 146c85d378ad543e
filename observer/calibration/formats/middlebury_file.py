"""Middlebury's ``calib.txt`` (stereo data sets since 2014): a rectified pair, millimetres.

Z = baseline f / (d + doffs): the two cameras' principal points are doffs pixels apart, which their
matrices cam0 and cam1 say as well.
"""

from __future__ import annotations

import re

import numpy as np

from observer.calibration.formats.numbers import number_array, shaped_numbers, whole_number
from observer.calibration.formats.plain_data import PlainData
from observer.calibration.formats.understanding import Draft
from observer.errors import CalibrationError
from observer.geometry import Float64Array

# The files give three decimals.
_DOFFS_TOLERANCE_PX = 0.01


def is_middlebury(text: str) -> bool:
    """Whether a text has a line ``cam0=[``."""
    return re.search(r"^\s*cam0\s*=\s*\[", text, re.MULTILINE) is not None


def middlebury_draft(name: str, text: str) -> Draft:
    """The calibration of a ``calib.txt``.

    Raises:
        CalibrationError: one sentence naming the file, the key and the reason.
    """
    entries = (line.partition("=") for line in text.splitlines())
    data: dict[str, PlainData] = {key.strip(): value for key, equal, value in entries if equal}
    for key in ("cam0", "cam1", "baseline", "width", "height"):
        if key not in data:
            raise CalibrationError(f"{name}: {key} is missing")
    K1, K2 = _camera_matrix(data, "cam0", name), _camera_matrix(data, "cam1", name)
    baseline = float(shaped_numbers(data, "baseline", (1,), name=name)[0])
    notes = ["the images are rectified already"]
    apart = K2[0, 2] - K1[0, 2]
    if "doffs" in data:
        doffs = float(shaped_numbers(data, "doffs", (1,), name=name)[0])
        if abs(doffs - apart) > _DOFFS_TOLERANCE_PX:
            raise CalibrationError(
                f"{name}: doffs is {doffs:g}, but the principal points of cam0 and cam1 are "
                f"{apart:g} pixels apart; both must be the same"
            )
    if apart:
        notes.append(f"the principal points are {apart:g} px apart (doffs), which is evened out")
    return Draft(
        source=name,
        format="Middlebury calib.txt",
        size=(
            whole_number(data["width"], key="width", name=name),
            whole_number(data["height"], key="height", name=name),
        ),
        K1=K1,
        D1=np.zeros(5),
        K2=K2,
        D2=np.zeros(5),
        R=np.eye(3),
        T=np.array([-baseline, 0.0, 0.0]),
        unit="mm",
        keys={"K1": "cam0", "K2": "cam1", "T": "baseline"},
        notes=tuple(notes),
    )


def _camera_matrix(data: dict[str, PlainData], key: str, name: str) -> Float64Array:
    text = str(data[key]).strip()
    if not (text.startswith("[") and text.endswith("]")):
        raise CalibrationError(f"{name}: {key} must be a matrix [fx 0 cx; 0 fy cy; 0 0 1]")
    rows: list[PlainData] = list(text[1:-1].split(";"))
    if len(rows) != 3:
        raise CalibrationError(f"{name}: {key} must have three rows, not {len(rows)}")
    matrix = [number_array(row, key=key, name=name) for row in rows]
    if any(row.size != 3 for row in matrix):
        raise CalibrationError(f"{name}: {key} must have three numbers in each row")
    return np.stack(matrix)
