"""Options that take a finite number."""

from __future__ import annotations

import math

import typer


def finite(value: float | None) -> float | None:
    """Return the value of an option, as its ``callback``.

    Raises:
        typer.BadParameter: it is infinite or not a number.
    """
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter(f"must be a finite number, not {value:g}")
    return value
