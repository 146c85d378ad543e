"""Which versions compute a run."""

from __future__ import annotations

import importlib.metadata
import platform

from observer.version import library_version


def versions() -> dict[str, str]:
    """What computes a run, by name."""
    packages = ("numpy", "opencv-python-headless")
    return {
        "dynamic-observer": library_version(),
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in packages},
    }
