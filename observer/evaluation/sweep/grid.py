"""Grid of parameters as YAML text, checked strictly against the parameters' declarations.

preset: [default, paper]          # if left out: default alone
set:                              # the same in every combination
  tracking.gate: 3.0
evidence.radius_px: [20, 26, 32]  # every value with every other
evidence.memory_s: [0.3, 0.5]

For crowds the parameters of guard and planner are varied, e.g.
``navigation.berth_m: [0.1, 0.2, 0.3]``; presets do not set them.
"""

from __future__ import annotations

import math
import random
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, TypeAlias

from pydantic import BeforeValidator, ConfigDict, Field, PlainValidator

from observer.errors import InputError, ParameterError
from observer.evaluation.navigation.parameters import crowd_parameters
from observer.navigation.parameters import AllParameters
from observer.parameters import Parameters, ParameterValue, preset, preset_names
from observer.text_files import (
    NUMBER,
    FileModel,
    PlainData,
    parse_text,
    read_text,
    shown,
    validated,
    word,
)

_FORM = "YAML with lists of values per parameter, for example evidence.radius_px: [20, 26]"
_WHOLE = re.compile(r"[-+]?\d{1,15}", re.ASCII)


@dataclass(frozen=True)
class Combination:
    """Point of the grid.

    Attributes:
        number: in the grid, from 1. preset: that it starts from.
        values: of the parameters that the grid varies, by name.
        parameters: all of them, including the fixed ones; for driving also those of guard and
            planner.
    """

    number: int
    preset: str
    values: Mapping[str, ParameterValue]
    parameters: Parameters


@dataclass(frozen=True)
class Grid:
    """Grid of parameters to combine.

    Attributes:
        presets: to start from. fixed: values of every combination.
        lists: the values of each parameter that is varied, by name, in the order of the text.
        driving: whether it varies parameters of guard and planner, for crowds.
    """

    presets: tuple[str, ...]
    fixed: Mapping[str, ParameterValue]
    lists: Mapping[str, tuple[ParameterValue, ...]]
    driving: bool = False

    @property
    def count(self) -> int:
        """Number of combinations."""
        return len(self.presets) * math.prod(len(values) for values in self.lists.values())

    def combination(self, number: int) -> Combination:
        """Return a combination by number, from 1; the text's last parameter varies fastest.

        Raises:
            ParameterError: its values are invalid together.
        """
        rest = number - 1
        values: dict[str, ParameterValue] = {}
        for name in reversed(list(self.lists)):
            rest, at = divmod(rest, len(self.lists[name]))
            values[name] = self.lists[name][at]
        base = self.presets[rest]
        values = {name: values[name] for name in self.lists}
        return Combination(number, base, values, self.parameters(base, values))

    def parameters(self, base: str, values: Mapping[str, ParameterValue]) -> Parameters:
        """Return a preset's parameters with the fixed and these values.

        Raises:
            ParameterError: they are invalid.
        """
        changes = {**self.fixed, **values}
        return crowd_parameters(changes) if self.driving else preset(base).changed(changes)

    def chosen(
        self, *, limit: int | None = None, drawn: int | None = None, seed: int = 0
    ) -> tuple[Combination, ...]:
        """Return all combinations, the first ``limit``, or ``drawn`` random ones, in order.

        Args:
            seed: of the random choice.

        Raises:
            InputError: both a limit and a random choice are given.
        """
        if limit is not None and drawn is not None:
            raise InputError("use either the first combinations or a random sample, not both")
        numbers: list[int] | range = range(1, self.count + 1)
        if drawn is not None and drawn < self.count:
            draw = random.Random(seed)  # nosec B311
            numbers = sorted(draw.sample(range(1, self.count + 1), drawn))
        return tuple(self.combination(number) for number in numbers[:limit])


def read_grid(path: Path, *, driving: bool = False) -> Grid:
    """Read a grid from a YAML file.

    Args:
        driving: whether it is for crowds.

    Raises:
        InputError: one sentence that names the file, the key and what would be right.
    """
    return grid_from_text(read_text(path, "a grid of parameters"), path.name, driving=driving)


def grid_from_text(text: str, name: str, *, driving: bool = False) -> Grid:
    """Read a grid from YAML text; ``name`` is its name in messages.

    Args:
        driving: whether it is for crowds.

    Raises:
        InputError: one sentence that names the key and what would be right.
    """
    data = parse_text(text, name=name, what="a grid of parameters", form=_FORM)
    read = validated(_GridFile, data, name)
    fixed = {key: _value(key, value) for key, value in read.set.items()}
    lists = {
        key: tuple(_value(key, value) for value in values)
        for key, values in (read.__pydantic_extra__ or {}).items()
    }
    for key, values in (("preset", read.preset), *lists.items()):
        if key in fixed:
            raise InputError(f"{name}: {key} is both fixed and varied; keep one of them")
        _check_differ(key, values, name)
    if driving and read.preset != ("default",):
        raise InputError(f"{name}: a preset has no effect on driving; omit preset")
    grid = Grid(read.preset, fixed, lists, driving)
    _check_values(grid, name)
    return grid


def _presets(value: PlainData) -> tuple[str, ...]:
    names = value if isinstance(value, list) else [value]
    known = ", ".join(preset_names())
    if not names:
        raise ValueError(f"must name at least one of {known}")
    for each in names:
        if each not in preset_names():
            raise ValueError(f"must name some of {known}, not {shown(each)}")
    return tuple(map(str, names))


def _fixed(value: PlainData) -> PlainData:
    if not isinstance(value, dict):
        raise ValueError(
            "must contain parameters with one value each, for example {tracking.gate: 3.0}"
        )
    return value


def _listed(value: PlainData) -> PlainData:
    if not isinstance(value, list) or not value:
        raise ValueError(
            "must have a list of values, for example [20, 26]; put values common to all "
            "combinations under set"
        )
    return value


_Text: TypeAlias = Annotated[str, word("must be a plain number or word")]


class _GridFile(FileModel):
    """Grid as written; every key except these two is a parameter to vary."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, Annotated[list[_Text], BeforeValidator(_listed)]]

    preset: Annotated[tuple[str, ...], PlainValidator(_presets)] = ("default",)
    set: Annotated[dict[str, _Text], BeforeValidator(_fixed)] = Field({})


def _value(key: str, value: str) -> ParameterValue:
    """Convert a value to its parameter's type; one that does not fit stays text and is refused."""
    declared = next((e for e in AllParameters.declared() if e["name"] == key), None)
    kind = "choice" if declared is None else declared["type"]
    if kind == "integer" and _WHOLE.fullmatch(value):
        return int(value)
    if kind == "number" and NUMBER.fullmatch(value):
        return float(value)
    if kind == "boolean" and value in ("true", "false"):
        return value == "true"
    return value


def _check_differ(key: str, values: tuple[ParameterValue, ...], name: str) -> None:
    for i, value in enumerate(values):
        if value in values[:i]:
            raise InputError(f"{name}: {key} lists {value} twice; keep one of them")


def _check_values(grid: Grid, name: str) -> None:
    """Check every value once rather than every combination, as a grid may have millions."""
    each: list[dict[str, ParameterValue]] = [{}]
    each += [{key: value} for key, values in grid.lists.items() for value in values]
    for base in grid.presets:
        for values in each:
            try:
                grid.parameters(base, values)
            except ParameterError as error:
                changes = {**grid.fixed, **values}
                given = ", ".join(f"{key} {str(changes[key])[:60]}" for key in error.problems)
                raise InputError(f"{name}: {error} (given: {given})") from None
