"""Which versions compute a run."""

from __future__ import annotations

import functools
import importlib.metadata
import platform


@functools.cache
def app_version() -> str:
    """The installed version; what runs from a bare source tree says so."""
    try:
        return importlib.metadata.version("dynamic-observer")
    except importlib.metadata.PackageNotFoundError:
        return "source"


def versions() -> dict[str, str]:
    """What computes a run, by name."""
    packages = ("numpy", "opencv-python-headless")
    return {
        "dynamic-observer": app_version(),
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in packages},
    }
