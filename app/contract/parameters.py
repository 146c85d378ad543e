"""Parameters and presets, as reported to clients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args

from app.contract.values import means
from observer.parameters import ParameterValue

# First field of a preset's file.
PresetFormat = Literal["dynamic-observer preset"]
PRESET_FORMAT: PresetFormat = get_args(PresetFormat)[0]
# Values of parameters by dotted name; all of them or some.
ParameterValues = Mapping[str, ParameterValue]
# The same as stored: by whatever version, or damaged by hand.
StoredValues = Mapping[str, Any]
# Maximum number of characters in the description of a preset.
LONGEST_PRESET_HELP = 300


@dataclass(frozen=True)
class ParametersNow:
    revision: Annotated[int, means("Incremented by every change of a parameter of the method.")]
    driving_revision: Annotated[
        int,
        means(
            "Incremented by every change of a guard.* or navigation.* parameter since the start."
        ),
    ]
    values: ParameterValues
    preset: Annotated[str | None, means("The preset with exactly these values.")]
    based_on: Annotated[
        str,
        means("The preset that the values started from; values that differ were changed by hand."),
    ]
    frame: Annotated[int | None, means("The first frame they apply to, if known.")]


@dataclass(frozen=True)
class ParametersChanged(ParametersNow):
    notes: Annotated[
        Sequence[str],
        means("One sentence for each given parameter that has no effect with the current method."),
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
        Sequence[str], means("Values of ego_motion.model with which it affects the observations.")
    ]
    cloud: Annotated[
        bool, means("Whether it affects the displayed dense cloud with every model.")
    ] = False
    basic: Annotated[
        bool, means("Whether it is one of the eight basic parameters of its methods.")
    ] = False
    minimum: float | None = None
    maximum: float | None = None
    step: float | None = None
    choices: Sequence[str] | None = None
    labels: Annotated[Mapping[str, str] | None, means("What to call each of the choices.")] = None


@dataclass(frozen=True)
class Preset:
    name: str
    help: str
    values: StoredValues
    built_in: bool
