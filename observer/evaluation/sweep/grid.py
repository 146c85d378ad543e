"""A grid of parameters as YAML text, read strictly by the parameters' own declaration.

preset: [default, paper]          # default alone where it is left out
set:                              # the same in every combination
  tracking.gate: 3.0
evidence.radius_px: [20, 26, 32]  # every value with every other
evidence.memory_s: [0.3, 0.5]
"""

from __future__ import annotations

import math
import random
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from observer.calibration.formats.plain_data import PlainData, parse_plain_data, read_text
from observer.errors import CalibrationError, InputError, ParameterError
from observer.parameters import Parameters, ParameterValue, preset, preset_names

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
_WHOLE = re.compile(r"[-+]?\d{1,15}", re.ASCII)


@dataclass(frozen=True)
class Combination:
    """One point of the grid.

    Attributes:
        number: in the grid, from 1. preset: what it starts from.
        values: of the parameters that the grid varies, by name.
        parameters: all of them, the fixed ones put in.
    """

    number: int
    preset: str
    values: Mapping[str, ParameterValue]
    parameters: Parameters


@dataclass(frozen=True)
class Grid:
    """What is to be combined.

    Attributes:
        presets: to start from. fixed: values of every combination.
        lists: the values of each parameter that is varied, by name, in the order of the text.
    """

    presets: tuple[str, ...]
    fixed: Mapping[str, ParameterValue]
    lists: Mapping[str, tuple[ParameterValue, ...]]

    @property
    def count(self) -> int:
        """How many combinations there are."""
        return len(self.presets) * math.prod(len(values) for values in self.lists.values())

    def combination(self, number: int) -> Combination:
        """The combination of a number from 1; the last parameter of the text changes fastest.

        Raises:
            ParameterError: its values are refused together.
        """
        rest = number - 1
        values: dict[str, ParameterValue] = {}
        for name in reversed(list(self.lists)):
            rest, at = divmod(rest, len(self.lists[name]))
            values[name] = self.lists[name][at]
        base = self.presets[rest]
        values = {name: values[name] for name in self.lists}
        return Combination(number, base, values, preset(base).changed({**self.fixed, **values}))

    def chosen(
        self, *, limit: int | None = None, drawn: int | None = None, seed: int = 0
    ) -> tuple[Combination, ...]:
        """All combinations, the first ``limit`` of them, or ``drawn`` of them by lot, in order.

        Args:
            seed: of the lot; the same seed draws the same combinations.

        Raises:
            InputError: both a limit and a lot are asked for.
        """
        if limit is not None and drawn is not None:
            raise InputError("a sweep takes the first combinations or a lot of them, not both")
        numbers: list[int] | range = range(1, self.count + 1)
        if drawn is not None and drawn < self.count:
            numbers = sorted(random.Random(seed).sample(range(1, self.count + 1), drawn))
        return tuple(self.combination(number) for number in numbers[:limit])


def read_grid(path: Path) -> Grid:
    """The grid of a YAML file.

    Raises:
        InputError: one sentence that names the file, the key and what would be right.
    """
    try:
        text = read_text(path)
    except CalibrationError as error:
        raise InputError(str(error).replace("a calibration file", "a grid of parameters")) from None
    return grid_from_text(text, path.name)


def grid_from_text(text: str, name: str) -> Grid:
    """The grid of a YAML text; ``name`` is what it is called in messages.

    Raises:
        InputError: one sentence that names the key and what would be right.
    """
    # The reader knows other notations too, and speaks of calibrations where it finds no keys.
    if text.lstrip()[:1] in ("", "<") or ":" not in text:
        raise InputError(
            f"{name}: a grid must be YAML that names parameters with lists of values, as in "
            f"evidence.radius_px: [20, 26]"
        )
    try:
        data = parse_plain_data(text, name=name)
    except CalibrationError as error:
        raise InputError(str(error)) from None
    presets = _presets(data.pop("preset", "default"), name)
    fixed = _fixed(data.pop("set", {}), name)
    lists = {
        key: tuple(_value(key, each, name) for each in _listed(key, value, name))
        for key, value in data.items()
    }
    for key, values in lists.items():
        if key in fixed:
            raise InputError(f"{name}: {key} is both fixed and varied; keep one of them")
        _check_differ(key, values, name)
    grid = Grid(presets, fixed, lists)
    _check_values(grid, name)
    return grid


def _presets(value: PlainData, name: str) -> tuple[str, ...]:
    names = value if isinstance(value, list) else [value]
    for each in names:
        if each not in preset_names():
            raise InputError(
                f"{name}: preset must name some of {', '.join(preset_names())}, not {_shown(each)}"
            )
    if not names:
        raise InputError(f"{name}: preset must name at least one of {', '.join(preset_names())}")
    presets = tuple(str(each) for each in names)
    _check_differ("preset", presets, name)
    return presets


def _fixed(value: PlainData, name: str) -> dict[str, ParameterValue]:
    if not isinstance(value, dict):
        raise InputError(
            f"{name}: set must hold parameters with one value each, as in "
            f"set: {{tracking.gate: 3.0}}"
        )
    return {key: _value(key, each, name) for key, each in value.items()}


def _listed(key: str, value: PlainData, name: str) -> list[PlainData]:
    if isinstance(value, list) and value:
        return value
    raise InputError(
        f"{name}: {_shown(key)} must have a list of values, as in [20, 26]; what is the same in "
        f"every combination stands under set"
    )


def _value(key: str, value: PlainData, name: str) -> ParameterValue:
    """The value as its parameter's type has it; what fits none stays text, and is refused."""
    if not isinstance(value, str):
        raise InputError(f"{name}: each value of {_shown(key)} must be a plain number or word")
    declared = next((e for e in Parameters.declared() if e["name"] == key), None)
    kind = "choice" if declared is None else declared["type"]
    if kind == "integer" and _WHOLE.fullmatch(value):
        return int(value)
    if kind == "number" and _NUMBER.fullmatch(value):
        return float(value)
    if kind == "boolean" and value in ("true", "false"):
        return value == "true"
    return value


def _check_differ(key: str, values: tuple[ParameterValue, ...], name: str) -> None:
    for i, value in enumerate(values):
        if value in values[:i]:
            raise InputError(f"{name}: {key} lists {value} twice; keep one of them")


def _check_values(grid: Grid, name: str) -> None:
    """Try every value once, rather than every combination: a grid may have millions."""
    for base in grid.presets:
        parameters = _changed(preset(base), grid.fixed, name)
        for key, values in grid.lists.items():
            for value in values:
                _changed(parameters, {key: value}, name)


def _changed(
    parameters: Parameters, changes: Mapping[str, ParameterValue], name: str
) -> Parameters:
    try:
        return parameters.changed(changes)
    except ParameterError as error:
        given = ", ".join(f"{key} {str(changes[key])[:60]}" for key in error.problems)
        raise InputError(f"{name}: {error} (given: {given})") from None


def _shown(value: PlainData) -> str:
    return repr(value[:60]) if isinstance(value, str) else "several values"
