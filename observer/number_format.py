"""Numbers in texts for people. Files and output meant for programs use plain ``format``."""

from __future__ import annotations


def format_number(value: float, digits: int, *, signed: bool = False) -> str:
    """Format a number for people: its minus is a true one (U+2212), as elsewhere on the page.

    A value rounded to zero has no minus: its sign means nothing.

    Args:
        digits: after the point. signed: a positive number has a plus.
    """
    plus = "+" if signed else ""
    return f"{value:{plus}z.{digits}f}".replace("-", "−")


def count_of(number: int, what: str) -> str:
    """Return a count with its noun, as in ``1 feature`` and ``3 features``."""
    return f"{number} {what}{'' if number == 1 else 's'}"
