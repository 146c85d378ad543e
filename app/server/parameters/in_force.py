"""The parameters in force, their revision, and the preset they came from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from observer.errors import InputError, ParameterError
from observer.guard.parameters import AllParameters
from observer.parameters import ParameterValue, preset, preset_names

BUILT_IN = preset_names()


@dataclass(frozen=True)
class ParametersInForce:
    """One state of the parameters.

    Attributes:
        values: all of them. revision: grows by one with every change of what is observed with,
            over restarts too. preset: the preset that these values are, or None once one differs.
        frame: the first frame they act on; None where no source was open or none is yet known.
        guard_revision: grows by one with every change of the guard, from 0 at the start.
    """

    values: AllParameters
    revision: int
    preset: str | None
    frame: int | None = None
    guard_revision: int = 0


@dataclass(frozen=True)
class Revision:
    """A change that was accepted, and what it changed."""

    after: ParametersInForce
    difference: dict[str, ParameterValue]


def first_parameters() -> ParametersInForce:
    """Those of a new installation."""
    return ParametersInForce(built_in("default"), 0, "default")


def restored_parameters(
    values: Mapping[str, Any], revision: int, preset_name: str | None
) -> tuple[ParametersInForce, str | None]:
    """The parameters as they were left.

    A later version may have other parameters or bounds; what it does not take is left at its
    default, and said.

    Returns:
        The parameters, and a warning of one sentence where some could not be restored.
    """
    try:
        return ParametersInForce(AllParameters().changed(values), revision, preset_name), None
    except ParameterError as error:
        refused = error.problems
    kept = {name: value for name, value in values.items() if name not in refused}
    restored = ParametersInForce(AllParameters().changed(kept), revision + 1, None)
    return restored, (
        f"saved parameters were refused and are at their defaults again: {', '.join(refused)}"
    )


def change(
    current: ParametersInForce,
    changes: Mapping[str, Any],
    presets: Mapping[str, Mapping[str, ParameterValue]],
    start: AllParameters | None = None,
) -> Revision:
    """The parameters after a change, all or nothing.

    Args:
        changes: dotted name -> new value.
        presets: the saved presets, by name; the built-in ones are known.
        start: what the changes are made to; the current values if left out.

    Raises:
        ParameterError: naming every refused field and its range.
    """
    values = (start or current.values).changed(changes)
    difference = current.values.difference(values)
    if not difference:
        return Revision(current, {})
    observed, guard = current.values.vision != values.vision, current.values.guard != values.guard
    after = ParametersInForce(
        values,
        current.revision + observed,
        matching_preset(values, presets),
        None if observed else current.frame,
        current.guard_revision + guard,
    )
    return Revision(after, difference)


def matching_preset(
    values: AllParameters, presets: Mapping[str, Mapping[str, ParameterValue]]
) -> str | None:
    """The name of the preset with exactly these values; built-in ones come first."""
    flat = values.flat()
    for name in reversed(BUILT_IN):
        if built_in(name).flat() == flat:
            return name
    return next((name for name, saved in presets.items() if dict(saved) == flat), None)


def built_in(name: str) -> AllParameters:
    """Return a built-in preset; the guard's parameters are at their defaults."""
    return AllParameters().changed(preset(name).flat())


def preset_values(name: str, presets: Mapping[str, Mapping[str, ParameterValue]]) -> AllParameters:
    """The parameters of a built-in or saved preset.

    Raises:
        InputError: there is none of that name.
        ParameterError: a saved one holds values that this version refuses.
    """
    if name in BUILT_IN:
        return built_in(name)
    if name not in presets:
        known = ", ".join((*BUILT_IN, *presets))
        raise InputError(f"there is no preset {name!r}; there are: {known}")
    return AllParameters().changed(presets[name])
