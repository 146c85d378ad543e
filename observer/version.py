"""The installed version of this project."""

from __future__ import annotations

import functools
import importlib.metadata


@functools.cache
def library_version() -> str:
    """Return the installed version; ``source`` if the code runs from a bare source tree."""
    try:
        return importlib.metadata.version("dynamic-observer")
    except importlib.metadata.PackageNotFoundError:
        return "source"
