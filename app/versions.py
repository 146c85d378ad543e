"""Versions of the software that computes a run."""

from __future__ import annotations

import importlib.metadata
import platform

from observer.version import library_version


def versions() -> dict[str, str]:
    """Return the versions of everything that computes a run, by name."""
    packages = ("numpy", "opencv-python-headless")
    return {
        "dynamic-observer": library_version(),
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in packages},
    }
