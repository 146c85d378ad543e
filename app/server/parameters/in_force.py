"""The current parameters, their revision, and the preset they came from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from app.contract.parameters import ParameterValues, StoredValues
from observer.errors import InputError, ParameterError
from observer.navigation.parameters import AllParameters
from observer.parameters import Parameters, ParameterValue, preset, preset_names

BUILT_IN = preset_names()


@dataclass(frozen=True)
class ParametersInForce:
    """State of the parameters.

    Attributes:
        values: all values. revision: incremented with every change of an observation parameter,
            across restarts too. preset: the preset with these values, or None once a value differs.
        based_on: the preset that the values come from; values that differ were changed by hand.
        frame: the first frame they apply to; None if no source was open or the frame is not yet
            known.
        driving_revision: incremented with every other change, from 0 at the start.
    """

    values: AllParameters
    revision: int
    preset: str | None
    frame: int | None = None
    driving_revision: int = 0
    based_on: str = "default"


@dataclass(frozen=True)
class Revision:
    """Accepted change of the parameters, with the changed values."""

    after: ParametersInForce
    difference: dict[str, ParameterValue]


def restored_parameters(
    values: StoredValues,
    revision: int,
    presets: Mapping[str, StoredValues],
    based_on: str | None,
) -> tuple[ParametersInForce, str | None]:
    """Restore the parameters of the last session.

    They may have been saved by a version with other parameters or bounds. A value that this version
    refuses is reset to its default, with a warning.

    Args:
        presets: the saved presets, by name. based_on: the name of the last preset, if known.

    Returns:
        The parameters, and a warning of one sentence if some could not be restored.
    """
    try:
        restored, refused = AllParameters().changed(values), {}
    except ParameterError as error:
        refused = error.problems
        kept = {name: value for name, value in values.items() if name not in refused}
        restored = AllParameters().changed(kept)
    current = ParametersInForce(restored, revision + bool(refused), None)
    warning = f"invalid saved parameters were reset to their defaults: {_listed(refused)}"
    return named(current, presets, based_on), warning if refused else None


def _listed(names: Iterable[str]) -> str:
    """Format names for display; data damaged by hand may hold any characters."""
    return ", ".join(name if name.isprintable() else repr(name) for name in names)


def change(
    current: ParametersInForce,
    changes: ParameterValues,
    presets: Mapping[str, StoredValues],
    start: AllParameters | None = None,
    based_on: str | None = None,
) -> Revision:
    """Return the parameters after a change; a change applies completely or not at all.

    Args:
        changes: dotted name -> new value.
        presets: the saved presets, by name, without the built-in ones.
        start: the values to change; the current ones if left out.
        based_on: the preset that the values come from; unchanged if left out.

    Raises:
        ParameterError: names every refused field and its range.
    """
    values = (start or current.values).changed(changes)
    difference = current.values.difference(values)
    observed = Parameters.own(difference)
    after = ParametersInForce(
        values,
        current.revision + bool(observed),
        None,
        None if observed else current.frame,
        current.driving_revision + (len(difference) > len(observed)),
    )
    return Revision(named(after, presets, based_on or current.based_on), difference)


def named(
    current: ParametersInForce,
    presets: Mapping[str, StoredValues],
    based_on: str | None,
) -> ParametersInForce:
    """Return the same values with the preset they equal, if any, and the one they are based on.

    Args:
        presets: the saved presets, by name. based_on: the preset they were based on so far; if it
            no longer exists, the nearest built-in preset replaces it.
    """
    preset = matching_preset(current.values, presets, based_on)
    if preset is None and based_on not in (*BUILT_IN, *presets):
        differing = {name: len(built_in(name).difference(current.values)) for name in BUILT_IN}
        based_on = min(reversed(BUILT_IN), key=differing.__getitem__)
    return replace(current, preset=preset, based_on=preset or based_on or "default")


def matching_preset(
    values: AllParameters,
    presets: Mapping[str, StoredValues],
    preferred: str | None = None,
) -> str | None:
    """Return the name of the preset with exactly these values.

    If several have them, return the preferred one, else a built-in one.
    """
    flat = values.flat()
    equal = [name for name in reversed(BUILT_IN) if built_in(name).flat() == flat]
    # A preset saved before a parameter was added takes the default of that parameter.
    declared = AllParameters().flat()
    equal += [name for name, saved in presets.items() if {**declared, **saved} == flat]
    return preferred if preferred in equal else next(iter(equal), None)


def built_in(name: str) -> AllParameters:
    """Return a built-in preset, with the driving parameters at their defaults."""
    return AllParameters().changed(preset(name).flat())


def preset_values(name: str, presets: Mapping[str, StoredValues]) -> AllParameters:
    """Return the parameters of a built-in or saved preset.

    Raises:
        InputError: there is no preset of that name.
        ParameterError: a saved preset has values that this version refuses.
    """
    if name in BUILT_IN:
        return built_in(name)
    if name not in presets:
        known = ", ".join((*BUILT_IN, *presets))
        raise InputError(f"there is no preset {name!r}; there are: {known}")
    return AllParameters().changed(presets[name])
