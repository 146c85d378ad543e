"""The detector SURF, which needs a package of its own."""

from __future__ import annotations

import importlib.util


def surf_missing() -> str | None:
    """Return one sentence on how to get SURF where it is not installed, otherwise None."""
    if importlib.util.find_spec("mahotas") is not None:
        return None
    return (
        "surf needs the package mahotas, which is not installed; install it by: "
        "pip install 'dynamic-observer[surf]'"
    )
