"""Parameters as typed on the command line: ``--set ego_motion.ransac_threshold_px=2``."""

from __future__ import annotations

import json
from collections.abc import Sequence

from observer.errors import InputError
from observer.parameters import Parameters, ParameterValue, effective, preset


def chosen_parameters(preset_name: str, assignments: Sequence[str]) -> Parameters:
    """Return a preset's parameters with ``name=value`` assignments applied.

    Raises:
        InputError: an assignment has no ``=``, or the preset is unknown.
        ParameterError: a parameter was refused; the message names each with its range, or the
            parameters that have no effect with the method in force.
    """
    changes: dict[str, ParameterValue] = {}
    for text in assignments:
        name, equals, value = text.partition("=")
        if not equals:
            raise InputError(
                f"--set takes NAME=VALUE, as in --set ego_motion.model=affine, not {text[:80]!r}"
            )
        changes[name.strip()] = _typed(value.strip())
    return effective(preset(preset_name), changes)


def _typed(text: str) -> ParameterValue:
    """Convert numbers and true/false to their types; keep everything else as text."""
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        # No JSON, or more digits or brackets than any value has.
        return text
    return value if isinstance(value, int | float | bool) else text
