"""Print the contents of a MAT-file: ``matlab_container`` runs this as a separate program.

It prints up to two lines of JSON: the variables as SciPy reads them, where objects of classes have
no properties, then the objects as read by mat-io, which the extra ``matlab`` installs. An array is
``["array", shape, numbers column by column]``, an object ``["object", class, properties]``; values
that calibrations do not need are null.
"""

import json
import sys
import warnings
from importlib import import_module
from typing import Any

import numpy as np

# Loading mat-io takes 0.4 GB of address space.
_MAX_MEMORY_BYTES = 2 << 30
# Far more than it takes: a damaged file may keep the reader busy for ever.
_MAX_PROCESSOR_S = 30
_MAX_DEPTH = 12
# Larger arrays are the corners and errors of a whole session, stored with the calibration.
_MAX_NUMBERS = 4096


def main(path: str) -> None:
    """Print the variables of the file."""
    try:
        import resource
    except ImportError:  # There is no such module on Windows.
        pass
    else:
        resource.setrlimit(resource.RLIMIT_AS, (_MAX_MEMORY_BYTES, _MAX_MEMORY_BYTES))
        resource.setrlimit(resource.RLIMIT_CPU, (_MAX_PROCESSOR_S, _MAX_PROCESSOR_S))
    # Both warn about types they do not know, mat-io also about a pandas option.
    warnings.simplefilter("ignore")
    from scipy.io import loadmat

    loaded = loadmat(path)
    # SciPy calls each object "None" and stores its name and class inside.
    answer = {
        each["s0"].decode("latin-1"): ["object", each["s2"].decode("latin-1"), None]
        for each in loaded.pop("None", ())
    }
    answer |= {key: _plain(value, 0) for key, value in loaded.items() if not key.startswith("__")}
    _answer(answer)
    if any(isinstance(value, list) and value[0] == "object" for value in answer.values()):
        # Imported by name, as it has no type hints.
        loaded = import_module("matio").load_from_mat(path)
        _answer(
            {
                key: ["object", value.classname, _plain(value, 0)]
                for key, value in loaded.items()
                if hasattr(value, "classname")
            }
        )


def _answer(answer: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(answer) + "\n")
    # The next step may crash the process.
    sys.stdout.flush()


def _plain(value: Any, depth: int) -> Any:
    """Return text, numbers, structs and objects, the latter two as mappings; null for the rest."""
    if depth > _MAX_DEPTH:
        return None
    if isinstance(value, np.ndarray) and value.size == 1 and value.dtype.kind not in "biuf":
        value = value.reshape(-1)[0]
    value = getattr(value, "properties", value)
    if isinstance(value, np.void) and value.dtype.names is not None:
        value = {key: value[key] for key in value.dtype.names}
    if isinstance(value, dict):
        plain = {str(key): _plain(each, depth + 1) for key, each in value.items()}
        # Classes with their own save format keep it under this name.
        within = plain.pop("any", None)
        return plain | within if isinstance(within, dict) else plain
    if isinstance(value, str):
        return str(value)
    if not isinstance(value, np.ndarray | np.number | int | float):
        return None
    numbers = np.asarray(value)
    if numbers.dtype.kind not in "biuf" or numbers.size > _MAX_NUMBERS:
        return None
    return ["array", numbers.shape, numbers.astype(np.float64).ravel(order="F").tolist()]


if __name__ == "__main__":
    main(sys.argv[1])
