"""Parameters and presets, as they are told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from app.contract.values import means


@dataclass(frozen=True)
class ParametersNow:
    revision: Annotated[int, means("Grows with every change of a parameter of observing.")]
    driving_revision: Annotated[
        int,
        means("Grows with every change of a guard.* or navigation.* parameter since the start."),
    ]
    values: Mapping[str, Any]
    preset: Annotated[str | None, means("The preset with exactly these values.")]
    based_on: Annotated[
        str, means("The preset that they come from; values that differ were changed by hand.")
    ]
    frame: Annotated[int | None, means("The first frame they act on, as far as known.")]


@dataclass(frozen=True)
class ParametersChanged(ParametersNow):
    notes: Annotated[
        Sequence[str],
        means("One sentence on each given parameter that does not act with the method."),
    ]


@dataclass(frozen=True)
class ParameterEntry:
    """All that a form needs to know of one parameter."""

    name: str
    group: str
    group_help: str
    title: str
    help: str
    type: Literal["number", "integer", "boolean", "choice"]
    unit: str
    default: Any
    models: Annotated[
        Sequence[str], means("With which ego_motion.model it acts on what is observed.")
    ]
    cloud: Annotated[
        bool, means("Whether it acts with every model on the dense cloud that is shown.")
    ] = False
    basic: Annotated[
        bool, means("Whether it is one of the eight that are shown first with its methods.")
    ] = False
    minimum: float | None = None
    maximum: float | None = None
    step: float | None = None
    choices: Sequence[str] | None = None


@dataclass(frozen=True)
class Preset:
    name: str
    help: str
    values: Mapping[str, Any]
    built_in: bool
