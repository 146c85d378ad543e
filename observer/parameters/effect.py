"""Check of changes: parameters without effect are reported, never silently ignored."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from observer.errors import ParameterError
from observer.parameters.groups import Parameters


def without_effect(names: Iterable[str], model: str) -> dict[str, str]:
    """Return the parameters that have no effect on what a method observes.

    Args:
        names: dotted; names that are not parameters of a method are ignored.
        model: the value of ``ego_motion.model``.

    Returns:
        Dotted name -> predicate that says with which methods the parameter acts.
    """
    named = set(names)
    return {
        entry["name"]: (
            f"has no effect with the current method, {model}; it applies to "
            f"{' and '.join(entry['models'])}"
            + (", and to the dense point cloud with every method" if entry.get("cloud") else "")
        )
        for entry in Parameters.declared()
        if entry["name"] in named and model not in entry["models"]
    }


def effective(parameters: Parameters, changes: Mapping[str, Any]) -> Parameters:
    """Return the parameters with the changes, each of which must have an effect.

    Raises:
        ParameterError: naming every refused field and its range, or else every one that has no
            effect with the method used after the change.
    """
    after = parameters.changed(changes)
    if idle := without_effect(changes, after.ego_motion.model):
        raise ParameterError(idle)
    return after
