"""Parameters as people type them: ``--set ego_motion.ransac_threshold_px=2``."""

from __future__ import annotations

import json
from collections.abc import Sequence

from observer.errors import InputError
from observer.parameters import Parameters, ParameterValue, effective, preset


def chosen_parameters(preset_name: str, assignments: Sequence[str]) -> Parameters:
    """A preset with the values of ``name=value`` assignments put in.

    Raises:
        InputError: an assignment has no ``=`` or the preset is unknown.
        ParameterError: naming every refused parameter and its range, or what does not act with
            the method in force.
    """
    changes: dict[str, ParameterValue] = {}
    for text in assignments:
        name, equals, value = text.partition("=")
        if not equals:
            raise InputError(
                f"--set takes NAME=VALUE, as in --set ego_motion.model=affine, not {text!r}"
            )
        changes[name.strip()] = _typed(value.strip())
    return effective(preset(preset_name), changes)


def _typed(text: str) -> ParameterValue:
    """Numbers and true/false as what they are, everything else as a word."""
    try:
        value = json.loads(text)
    except json.JSONDecodeError:
        return text
    return value if isinstance(value, int | float | bool) else text
