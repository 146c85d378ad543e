"""Reader of the JSON lines of ``observe``, with checks."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from observer.errors import InputError
from observer.validation import validation_words, with_name

Finite = Annotated[float, Field(allow_inf_nan=False)]
Vector = tuple[Finite, Finite, Finite]
Matrix = tuple[Vector, Vector, Vector]
Quaternion = tuple[Finite, Finite, Finite, Finite]
Share = Annotated[float, Field(ge=0, le=1)]

# Tolerance for rounding in other tools that write such lines.
_UNIT_WITHIN = 1e-3


class _Entry(BaseModel):
    # Lines may contain more than evaluation needs.
    model_config = ConfigDict(frozen=True, extra="ignore")


class CheckedPose(_Entry):
    """Pose of the camera in the segment's world."""

    position: Vector
    orientation_wxyz: Quaternion

    @field_validator("orientation_wxyz")
    @classmethod
    def _unit(cls, quaternion: tuple[float, ...]) -> tuple[float, ...]:
        if abs(math.hypot(*quaternion) - 1) > _UNIT_WITHIN:
            raise ValueError("must be a unit quaternion")
        return quaternion


class CheckedObstacle(_Entry):
    """Fields of a reported obstacle that evaluation needs; see ``observer.jsonl``."""

    id: int
    state: str
    motion: str
    position: Vector | None
    velocity: Vector | None
    speed: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    velocity_cov: Matrix | None
    velocity_time: Finite
    box_px: tuple[Finite, Finite, Finite, Finite] | None = None


class Unseen(_Entry):
    """Regions of the rectified left image in which motion could not be noticed.

    Attributes:
        share: of the image. causes: shares by cause.
        rows: of square cells of ``cell_px``, from the top, a letter for each cell from the left;
            "." is a cell in which motion could be noticed, any other letter one in which it could
            not.
    """

    share: Share
    causes: dict[str, Share]
    cell_px: Annotated[int, Field(ge=1)]
    rows: Annotated[tuple[Annotated[str, Field(min_length=1)], ...], Field(min_length=1)]

    @field_validator("rows")
    @classmethod
    def _equally_long(cls, rows: tuple[str, ...]) -> tuple[str, ...]:
        if len({len(row) for row in rows}) > 1:
            raise ValueError("all rows must have the same length")
        return rows


class Line(_Entry):
    """Fields of a frame that evaluation needs; ``unseen`` is None if the method reports none."""

    frame: int
    time: Finite
    segment: int
    status: str
    pose: CheckedPose | None
    obstacles: tuple[CheckedObstacle, ...]
    unseen: Unseen | None = None


def checked_lines(lines: Iterable[Mapping[str, Any]]) -> tuple[Line, ...]:
    """Check lines as made by ``observer.jsonl.observation_line``.

    Raises:
        InputError: naming the first invalid line and field, or a line that is out of order in
            time.
    """
    return _checked(enumerate(lines, 1))


def read_both(path: Path) -> tuple[tuple[Line, ...], tuple[dict[str, Any], ...]]:
    """Read a file of JSON lines, and return the lines and their full content as dictionaries.

    Raises:
        InputError: the file cannot be read, or as for ``checked_lines``.
    """
    try:
        with path.open(encoding="utf-8") as file:
            contents = [(n, text) for n, text in enumerate(file, 1) if text.strip()]
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path.name}: the file must contain JSON lines in UTF-8") from None
    lines = []
    for number, text in contents:
        try:
            lines.append((number, json.loads(text)))
        except (ValueError, RecursionError):
            # A plain ValueError is raised for an integer with thousands of digits.
            raise InputError(f"{path.name} line {number} is not valid JSON") from None
    if not lines:
        raise InputError(f"{path.name} contains no lines")
    return _checked(lines), tuple(content for _, content in lines)


def _line(content: Any, number: int) -> Line:
    try:
        return Line.model_validate(content)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(str(part)[:60] for part in first["loc"]) or "the line"
        said = with_name(place, validation_words(first))
        raise InputError(f"line {number}, {said}") from None


def _checked(contents: Iterable[tuple[int, Any]]) -> tuple[Line, ...]:
    """Check numbered lines and the order of their times."""
    numbered = [(number, _line(content, number)) for number, content in contents]
    for (_, before), (number, after) in pairwise(numbered):
        if after.segment == before.segment and after.time < before.time:
            raise InputError(
                f"line {number} has the time {after.time:g} s, which is before {before.time:g} s "
                "on the line above, in the same segment"
            )
    return tuple(line for _, line in numbered)
