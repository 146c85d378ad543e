"""The installed version of this project."""

from __future__ import annotations

import functools
import importlib.metadata

# The two distributions: everything, and the library alone.
COMPLETE = "dynamic-observer"
_LIBRARY = "dynamic-observer-library"


@functools.cache
def library_version() -> str:
    """Return the installed version; ``source`` if the code runs from a bare source tree."""
    return installed_version(COMPLETE) or installed_version(_LIBRARY) or "source"


def installed_version(distribution: str) -> str | None:
    """Return the version of a distribution; None if it is not installed."""
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return None
