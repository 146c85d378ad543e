"""Check for the package that the SURF detector needs."""

from __future__ import annotations

import importlib.util


def surf_missing() -> str | None:
    """Return one sentence on how to install SURF; None if it is installed."""
    if importlib.util.find_spec("mahotas") is not None:
        return None
    return (
        "surf needs the package mahotas, which is not installed; install it with: pip install "
        "'dynamic-observer[surf]'"
    )
