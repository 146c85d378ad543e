"""Objects of MATLAB's classes in a MAT-file, read by mat-io in a process of its own.

MATLAB does not document how objects lie in a file; mat-io, which the extra ``matlab`` installs,
knows it, but damaged files end it and the process around it. So it runs apart, with limits on time
and memory, and answers in JSON.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from observer.calibration.formats.matlab_container import MatlabValue
from observer.errors import CalibrationError

# Loading mat-io takes about a second, reading next to none.
_PATIENCE_S = 30.0
_MAX_MEMORY_BYTES = 4 << 30
_MAX_DEPTH = 8


def is_mat_io_installed() -> bool:
    """Whether the extra ``matlab`` is there."""
    return importlib.util.find_spec("matio") is not None


def object_properties(content: bytes, class_name: str, *, name: str) -> dict[str, MatlabValue]:
    """The properties of the object of this class in a MAT-file, objects within it as dicts.

    Raises:
        CalibrationError: mat-io cannot read it.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "calibration.mat"
        path.write_bytes(content)
        try:
            done = subprocess.run(
                [sys.executable, "-m", __spec__.name, str(path), class_name],
                stdin=subprocess.DEVNULL,
                capture_output=True,
                timeout=_PATIENCE_S,
                # Each of its threads would count against the memory it may claim.
                env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
                check=False,
            )
            answer = json.loads(done.stdout) if done.returncode == 0 else None
        except (subprocess.TimeoutExpired, ValueError):
            answer = None
    properties = _from_json(answer)
    if not isinstance(properties, dict):
        raise CalibrationError(f"{name}: the object of class {class_name} cannot be read")
    return properties


def _from_json(value: Any) -> MatlabValue:
    if isinstance(value, dict) and set(value) == {"shape", "numbers"}:
        return np.array(value["numbers"], dtype=np.float64).reshape(value["shape"], order="F")
    if isinstance(value, dict):
        return {key: _from_json(each) for key, each in value.items()}
    return value if isinstance(value, str) else None


def _answer(path: str, class_name: str) -> None:
    """What the process of its own does: the object's properties as JSON on stdout."""
    with contextlib.suppress(ImportError):  # There is no such module on Windows.
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (_MAX_MEMORY_BYTES, _MAX_MEMORY_BYTES))
    # It sets an option of pandas that is deprecated, and warns of types it does not know.
    warnings.simplefilter("ignore")
    variables = importlib.import_module("matio").load_from_mat(path)
    found = (v for v in variables.values() if getattr(v, "classname", None) == class_name)
    json.dump(_to_json(next(found, None), 0), sys.stdout)


def _to_json(value: Any, depth: int) -> Any:
    """What mat-io returns as strings, dicts and arrays of numbers; null for anything else."""
    if depth > _MAX_DEPTH:
        return None
    value = getattr(value, "properties", value)
    if isinstance(value, np.ndarray):
        if value.dtype.names is None and value.dtype.kind in "biuf":
            numbers = value.astype(np.float64).ravel(order="F").tolist()
            return {"shape": list(value.shape), "numbers": numbers}
        if value.size != 1:
            return None
        value = value.reshape(-1)[0]
        value = getattr(value, "properties", value)
    if isinstance(value, np.void) and value.dtype.names is not None:
        value = {key: value[key] for key in value.dtype.names}
    if isinstance(value, dict):
        # How classes that save themselves in a form of their own are kept.
        if set(value) == {"any"}:
            return _to_json(value["any"], depth + 1)
        return {str(key): _to_json(each, depth + 1) for key, each in value.items()}
    if isinstance(value, str):
        return str(value)
    if isinstance(value, int | float):
        return {"shape": [1, 1], "numbers": [float(value)]}
    return None


if __name__ == "__main__":
    _answer(*sys.argv[1:3])
