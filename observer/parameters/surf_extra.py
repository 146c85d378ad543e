"""Check for the package that the SURF detector needs."""

from __future__ import annotations

import importlib.util

from observer.version import install_command


def surf_missing() -> str | None:
    """Return one sentence on how to install SURF; None if it is installed."""
    if importlib.util.find_spec("mahotas") is not None:
        return None
    return (
        "surf needs the package mahotas, which is not installed; install it with: "
        + install_command("surf", "mahotas")
    )
