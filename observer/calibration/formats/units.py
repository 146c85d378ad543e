"""Units of the lengths in calibration files; given by the user, never guessed from a size.

Every interface that takes a unit (the command line, REST, the panel) accepts what ``parse_unit``
accepts, explains it by ``UNIT_HELP``, and names its own control where a file needs another unit
(``UnitUnclear.asking``).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Literal, TypeAlias

from observer.calibration.formats.known import UNIT_HELP
from observer.camera import (
    MAX_BASELINE_M,
    MIN_BASELINE_M,
    is_plausible_baseline,
    may_be_squares,
)
from observer.errors import CalibrationError

Unit = Literal["m", "mm", "cm", "in"]
# A unit by name, or how many metres one unit of the file is: the square of a board.
LengthUnit: TypeAlias = "Unit | float"

_METRES: Mapping[Unit, float] = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "in": 0.0254}
_WORDS: Mapping[Unit, str] = {
    "m": "metres",
    "mm": "millimetres",
    "cm": "centimetres",
    "in": "inches",
}
_SAID = re.compile(r"\s*(\d{1,9}\.?\d{0,9}|\.\d{1,9})?\s*(m|mm|cm|in)\s*", re.ASCII)


class UnitUnclear(CalibrationError):
    """A baseline that is implausible in the unit it was read in; only the user knows the right one.

    Args:
        problem: what is wrong, and where.
        baseline: as in the file, positive. unit: in which it was read.
        request: what the user is to do, with ``{}`` for the unit, as in ``say --unit {}``.
    """

    def __init__(
        self, problem: str, baseline: float, unit: LengthUnit, request: str = "set unit={!r}"
    ) -> None:
        super().__init__(f"{problem}; {_question(baseline, unit, request)}")
        self._problem, self._baseline, self._unit = problem, baseline, unit

    def asking(self, request: str) -> UnitUnclear:
        """Return the same error with another request, which names the caller's own control."""
        return UnitUnclear(self._problem, self._baseline, self._unit, request)


def parse_unit(text: str) -> LengthUnit:
    """Return the unit that was entered: ``mm``, or ``25mm`` if one unit of the file is 25 mm.

    Raises:
        CalibrationError: it is neither.
    """
    found = _SAID.fullmatch(text)
    if found is not None:
        number, word = found.groups()
        unit = next(each for each in _METRES if each == word)
        if number is None:
            return unit
        if metres := float(number) * _METRES[unit]:
            return metres
    raise CalibrationError(f"the unit {text[:40]!r} is not known; use {UNIT_HELP}")


def metres(unit: LengthUnit) -> float:
    """Return how many metres one unit is."""
    return unit if isinstance(unit, float) else _METRES[unit]


def unit_words(unit: LengthUnit) -> str:
    """Return the unit's name in the plural."""
    return f"units of {1e3 * unit:.6g} mm" if isinstance(unit, float) else _WORDS[unit]


def implausible(baseline: float, unit: LengthUnit) -> str:
    """Return the clause on a baseline that is implausible in this unit; it begins with T.

    Args:
        baseline: as in the file, positive. unit: in which it was read.
    """
    return (
        f"T gives a baseline of {baseline * metres(unit):g} m when read in {unit_words(unit)}, "
        f"which is outside {MIN_BASELINE_M:g} to {MAX_BASELINE_M:g} m"
    )


def _question(baseline: float, unit: LengthUnit, request: str) -> str:
    """Return which units would fit, and what to do if the file is in one of them."""
    fitting = [
        f"in {_WORDS[each]} ({_length(baseline * factor)}), {request.format(each)}"
        for each, factor in _METRES.items()
        # Cameras are seldom calibrated in inches, and whoever does so knows.
        if each not in (unit, "in") and is_plausible_baseline(baseline * factor)
    ]
    squares = f"in squares of a board of 25 mm, {request.format('25mm')}"
    if not fitting:
        return f"no unit of length gives a plausible baseline; if the file is {squares}"
    if may_be_squares(baseline):
        fitting.append(squares)
    return f"if the file is {'; if '.join(fitting)}"


def _length(length_m: float) -> str:
    return f"{1e3 * length_m:.3g} mm" if length_m < 1 else f"{length_m:.3g} m"
