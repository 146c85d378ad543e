"""Parameters as typed on the command line: ``--set ego_motion.ransac_threshold_px=2``."""

from __future__ import annotations

from collections.abc import Sequence

from observer.errors import InputError
from observer.parameters import Parameters, ParameterValue, effective, preset, typed_value


def chosen_parameters(preset_name: str, assignments: Sequence[str]) -> Parameters:
    """Return a preset's parameters with ``name=value`` assignments applied.

    Raises:
        InputError: an assignment has no ``=``, or the preset is unknown.
        ParameterError: a parameter was refused; the message names each with its range, or the
            parameters that have no effect with the current method.
    """
    return effective(preset(preset_name), changes_of(assignments))


def changes_of(assignments: Sequence[str]) -> dict[str, ParameterValue]:
    """Return the values of ``name=value`` assignments by name.

    Raises:
        InputError: an assignment has no ``=``.
    """
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
