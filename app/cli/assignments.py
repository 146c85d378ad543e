"""Parameters as typed on the command line: ``--set ego_motion.ransac_threshold_px=2``."""

from __future__ import annotations

from collections.abc import Sequence

from observer.errors import InputError, ParameterError
from observer.navigation.parameters import AllParameters
from observer.parameters import Parameters, ParameterValue, effective, preset, typed_value


def chosen_parameters(preset_name: str, assignments: Sequence[str]) -> Parameters:
    """Return a preset's parameters with ``name=value`` assignments applied.

    Raises:
        InputError: an assignment has no ``=``, or the preset is unknown.
        ParameterError: a parameter was refused; the message names each with its range, or the
            parameters that have no effect with the method in force.
    """
    return effective(preset(preset_name), _changes(assignments))


def driving_parameters(assignments: Sequence[str]) -> AllParameters:
    """Return the default parameters with ``name=value`` assignments to guard and planner applied.

    Raises:
        InputError: an assignment has no ``=``.
        ParameterError: a parameter was refused, or acts on what is seen in images.
    """
    changes = _changes(assignments)
    parameters = AllParameters().changed(changes)
    if seeing := Parameters.own(changes):
        raise ParameterError(
            dict.fromkeys(seeing, "has no effect: people are perceived without images")
        )
    return parameters


def _changes(assignments: Sequence[str]) -> dict[str, ParameterValue]:
    changes: dict[str, ParameterValue] = {}
    for text in assignments:
        name, equals, value = text.partition("=")
        if not equals:
            raise InputError(
                "--set takes NAME=VALUE, for example --set ego_motion.model=affine, not "
                f"{text[:80]!r}"
            )
        changes[name.strip()] = typed_value(value.strip())
    return changes
