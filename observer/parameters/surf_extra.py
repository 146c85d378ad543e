"""Check for the package that the SURF detector needs."""

from __future__ import annotations

import importlib.util

from observer.extras import package_missing


def surf_missing() -> str | None:
    """Return one sentence on how to install SURF; None if it is installed."""
    if importlib.util.find_spec("mahotas") is not None:
        return None
    return package_missing("surf", "surf", "mahotas")
