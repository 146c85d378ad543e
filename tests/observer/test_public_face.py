"""The library's public API: what ``import observer`` offers, and how it looks in a notebook."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import observer
from observer.types import StereoFrame


def test_every_public_name_exists() -> None:
    assert set(observer.__all__) >= {
        "open", "load", "Observer", "StereoFrame", "StereoCalibration", "Parameters", "__version__",
    }  # fmt: skip
    for name in observer.__all__:
        assert getattr(observer, name) is not None
    assert observer.StereoFrame is StereoFrame
    assert observer.__version__
    with pytest.raises(AttributeError, match="no attribute 'Observr'"):
        _ = observer.Observr


def test_the_import_loads_no_heavy_package() -> None:
    code = (
        "import sys, observer;"
        "print([m for m in ('numpy', 'cv2', 'scipy', 'pydantic') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.strip() == "[]"


def test_the_library_loads_no_web_viewer_or_database_package() -> None:
    code = (
        "import sys, observer;"
        "source = observer.open('simulated:lab'); next(source.steps(1)); source.close();"
        "print([m for m in ('fastapi', 'starlette', 'viser', 'sqlalchemy', 'uvicorn', 'app')"
        " if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.strip() == "[]"


def test_the_package_contains_a_py_typed_marker() -> None:
    assert (Path(observer.__file__).parent / "py.typed").is_file()


def test_notebook_representations_are_short() -> None:
    with observer.open("simulated:lab") as source:
        steps = list(source.steps(2, trace=True))
        assert repr(source) == "<observed source simulated:lab, 512x256>"
        assert repr(source.calibration).startswith("<calibration 512x256, f 443")
    assert repr(steps[1].frame) == "<frame 1 at 0.067 s, 512x256>"
    assert repr(steps[1]) == "<step: <observation of frame 1 at 0.067 s, ok, 0 obstacles>>"
    assert len(repr(steps)) < 200


def test_a_trace_is_recorded_only_on_request() -> None:
    with observer.open("simulated:lab") as source:
        (first,) = source.steps(1)
        (second,) = source.steps(1, trace=True)
    assert first.trace is None
    assert second.trace is not None
    assert second.trace["left"].shape[:2] == (256, 512)
    assert isinstance(second.trace["features_px"], np.ndarray)
