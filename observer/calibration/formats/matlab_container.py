"""MATLAB's MAT-files of level 5 (``save -v6`` and ``-v7``), read in a process of its own.

Some damaged files crash SciPy's reader, and mat-io's, together with their process; so these run
in a separate one (``matlab_objects``), with limits on time and memory, and answer in JSON.
"""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
import tempfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from observer.calibration.formats import matlab_objects
from observer.errors import CalibrationError
from observer.geometry import Float64Array

# A calibration app's session has a few MB besides the calibration (corners, errors).
_MAX_EXPANDED_BYTES = 16_000_000
# Loading SciPy or mat-io takes up to a second, reading takes almost no time, but a busy computer
# may be slow to give the process its share. ``matlab_objects`` limits its own processor time.
_PATIENCE_S = 120.0
_HEADER_BYTES = 128
_COMPRESSED = 15


@dataclass(frozen=True, eq=False)
class MatlabObject:
    """An object of a class; its properties are None where they cannot be read."""

    class_name: str
    properties: MatlabValue


# A 1x1 struct is a mapping; values that calibrations do not need are None.
MatlabValue: TypeAlias = "Float64Array | str | dict[str, MatlabValue] | MatlabObject | None"


def read_matlab_variables(content: bytes, *, name: str) -> dict[str, MatlabValue]:
    """Return the variables of a MAT-file of level 5.

    Numbers become float64 arrays in MATLAB's shape, text becomes str, a struct a dict.

    Raises:
        CalibrationError: the file is cut off, damaged or too large once expanded, or the computer
            is too busy to read it.
    """
    _check_expanded(content, name)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "calibration.mat"
        path.write_bytes(content)
        try:
            done = subprocess.run(
                [sys.executable, "-P", matlab_objects.__file__, str(path)],
                stdin=subprocess.DEVNULL,
                capture_output=True,
                timeout=_PATIENCE_S,
                # Each of its threads would count against its memory limit.
                env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
                check=False,
            )
            answers = [json.loads(line) for line in done.stdout.splitlines()]
        except subprocess.TimeoutExpired:
            raise CalibrationError(
                f"{name} was not read within {_PATIENCE_S:g} s because this computer is too busy; "
                "try again"
            ) from None
        except ValueError:
            answers = []
    if not answers:
        raise CalibrationError(
            f"{name}: the MAT-file is truncated or damaged, or the shape of an array does not "
            "match its number of elements"
        )
    return {title: _value(value) for each in answers for title, value in each.items()}


def _value(answer: Any) -> MatlabValue:
    match answer:
        case ["array", shape, numbers]:
            return np.array(numbers, dtype=np.float64).reshape(shape, order="F")
        case ["object", str(class_name), properties]:
            return MatlabObject(class_name, _value(properties))
        case dict():
            return {key: _value(each) for key, each in answer.items()}
    return answer if isinstance(answer, str) else None


def _check_expanded(content: bytes, name: str) -> None:
    """Refuse files that are truncated or that would expand without bound."""
    damaged = f"{name}: the MAT-file is truncated or damaged"
    order = {b"IM": "<", b"MI": ">"}.get(content[126:_HEADER_BYTES])
    if order is None:
        raise CalibrationError(f"{damaged} in its header")
    expanded, at = 0, _HEADER_BYTES
    while at < len(content):
        kind, length = struct.unpack(order + "II", content[at : at + 8].ljust(8, b"\xff"))
        part = content[at + 8 : at + 8 + length]
        if len(part) < length:
            raise CalibrationError(f"{damaged}: a part is longer than the file")
        at += 8 + length
        if kind != _COMPRESSED:
            continue
        try:
            limit = _MAX_EXPANDED_BYTES - expanded + 1
            expanded += len(zlib.decompressobj().decompress(part, limit))
        except zlib.error:
            raise CalibrationError(f"{damaged}: a part cannot be decompressed") from None
        if expanded > _MAX_EXPANDED_BYTES:
            raise CalibrationError(
                f"{name}: the MAT-file is larger than {_MAX_EXPANDED_BYTES} bytes when "
                "decompressed; save only the stereo parameters"
            )
