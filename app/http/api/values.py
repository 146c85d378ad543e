"""Values as the REST interface takes them: strict, finite, bounded."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, StrictBool, StrictFloat, StrictInt, StrictStr

from app.contract.parameters import ParameterValues
from app.contract.values import LONGEST_NAME, LONGEST_SPEC
from observer.calibration.boards.board import (
    MAX_SIDE_CORNERS,
    MAX_SQUARE_MM,
    MIN_SIDE_CORNERS,
    MIN_SQUARE_MM,
)
from observer.parameters import without_effect

# Python's JSON parser accepts NaN; strict, finite types reject it, and true as a number.
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Value = StrictBool | StrictInt | StrictFloat | StrictStr
# Pattern of text without control characters.
ONE_LINE = r"^[^\x00-\x1f\x7f]*$"
# Pattern of any other text: PostgreSQL allows no NUL.
NO_NUL = r"^[^\x00]*$"
Name = Annotated[str, Field(strict=True, min_length=1, max_length=LONGEST_NAME, pattern=ONE_LINE)]
Tag = Annotated[str, Field(strict=True, min_length=1, max_length=60, pattern=ONE_LINE)]
# Text of any number of lines.
Text = Annotated[str, Field(strict=True, max_length=20_000, pattern=NO_NUL)]
# Id of a lease or a calibration, or name of a programme.
Identifier = Annotated[str, Field(strict=True, min_length=1, max_length=100)]
Spec = Annotated[str, Field(strict=True, min_length=1, max_length=LONGEST_SPEC)]
# Times and differences of times on any clock stay below this, s.
FARTHEST_S = 1e12
# Inner corners of a board across or down, and the side of its squares.
Corners = Annotated[int, Field(ge=MIN_SIDE_CORNERS, le=MAX_SIDE_CORNERS)]
SquareMm = Annotated[float, Field(ge=MIN_SQUARE_MM, le=MAX_SQUARE_MM, allow_inf_nan=False)]
# Largest position of a frame in a source: a year at 30 Hz.
LAST_FRAME = 1_000_000_000
# More than there are parameters.
MOST_CHANGES = 300
Changes = Annotated[
    dict[Annotated[str, Field(max_length=100)], Value], Field(max_length=MOST_CHANGES)
]


def notes_on(changes: Iterable[str], values: ParameterValues) -> list[str]:
    """Return a sentence on each changed parameter that has no effect with the current method.

    Args:
        changes: dotted names. values: all current values.
    """
    idle = without_effect(changes, str(values["ego_motion.model"]))
    return [f"{name} {sentence}" for name, sentence in idle.items()]


class In(BaseModel):
    """Something a client sends: unknown fields are refused."""

    model_config = ConfigDict(extra="forbid")
