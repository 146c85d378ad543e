"""Parameters that affect a drive through a crowd."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from observer.errors import ParameterError
from observer.navigation.parameters import AllParameters
from observer.parameters import Parameters


def crowd_parameters(changes: Mapping[str, Any]) -> AllParameters:
    """Return the default parameters with changes to guard and planner.

    Raises:
        ParameterError: naming every invalid parameter, or else every parameter of observing.
    """
    parameters = AllParameters().changed(changes)
    if seeing := Parameters.own(changes):
        raise ParameterError(
            dict.fromkeys(seeing, "has no effect here: only those of guard and navigation have one")
        )
    return parameters
