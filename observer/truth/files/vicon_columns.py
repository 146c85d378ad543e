"""Columns of a Vicon CSV, by its three header rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from observer.errors import TruthError
from observer.truth.files.body_names import BodyNames
from observer.truth.files.text_lines import TextLines
from observer.truth.files.units import ANGLES_RAD, LENGTHS_M

ColumnKind = Literal["helical or euler", "quaternion", "marker"]

_TITLES: dict[ColumnKind, tuple[str, ...]] = {
    "quaternion": ("RX", "RY", "RZ", "RW", "TX", "TY", "TZ"),
    "helical or euler": ("RX", "RY", "RZ", "TX", "TY", "TZ"),
    "marker": ("X", "Y", "Z"),
}
# Number of columns before the bodies: Frame and Sub Frame.
_BEFORE = 2
_PREFIX = "global angle "


@dataclass(frozen=True)
class BodyColumns:
    """Columns of a body or marker.

    Attributes:
        rotation: indices of RX, RY, RZ (and RW); empty for a marker. position: of x, y, z.
        rotation_scale: to radians. position_scale: to metres, with ``unit`` its name.
    """

    name: str
    kind: ColumnKind
    rotation: tuple[int, ...]
    position: tuple[int, ...]
    rotation_scale: float
    position_scale: float
    unit: str

    @property
    def labels(self) -> list[str]:
        """Names of its cells, in the file's order, for messages."""
        return [f"{axis} of {self.name}" for axis in _TITLES[self.kind]]


def is_frame_row(cells: Sequence[str]) -> bool:
    """Return whether a row is the one that names the columns: ``Frame,Sub Frame,...``."""
    first = [cell.strip().lower().replace(" ", "") for cell in cells[:_BEFORE]]
    return first == ["frame", "subframe"]


def body_columns(
    lines: TextLines,
    names: Sequence[str],
    titles: Sequence[str],
    units: Sequence[str],
    taken: BodyNames,
) -> list[BodyColumns]:
    """Return the columns by body of a section; its row of units is the line read last.

    Args:
        taken: the names given so far.

    Raises:
        TruthError: a column or a unit is not known.
    """
    titles = [title.strip().upper() for title in titles]
    while len(titles) > _BEFORE and not titles[-1]:
        titles.pop()
    bodies: list[BodyColumns] = []
    at = _BEFORE
    while at < len(titles):
        kind, width = _kind_at(lines, titles, at)
        name = taken.of(_name(names[at] if at < len(names) else ""))
        turn = width - 3
        rotation = tuple(range(at, at + turn))
        position = tuple(range(at + turn, at + width))
        unit, length = _unit(lines, units, position, LENGTHS_M, "a length in mm, cm or m")
        angle = 1.0
        if kind == "helical or euler":
            _, angle = _unit(lines, units, rotation, ANGLES_RAD, "an angle in rad or deg")
        bodies.append(BodyColumns(name, kind, rotation, position, angle, length, unit))
        at += width
    if not bodies:
        raise TruthError(
            f"{lines.where(lines.number - 1)}: no columns after Frame and Sub Frame; each body "
            "needs X,Y,Z or RX,RY,RZ,TX,TY,TZ"
        )
    return bodies


def _kind_at(lines: TextLines, titles: Sequence[str], at: int) -> tuple[ColumnKind, int]:
    for kind, pattern in _TITLES.items():
        if tuple(titles[at : at + len(pattern)]) == pattern:
            return kind, len(pattern)
    raise TruthError(
        f"{lines.where(lines.number - 1, at + 1)}: the columns from {titles[at][:40]!r} on are not "
        "known; each body needs X,Y,Z or RX,RY,RZ,TX,TY,TZ"
    )


def _unit(
    lines: TextLines,
    units: Sequence[str],
    columns: Sequence[int],
    known: dict[str, float],
    right: str,
) -> tuple[str, float]:
    found = [units[c].strip().lower() if c < len(units) else "" for c in columns]
    for column, unit in zip(columns, found, strict=True):
        if unit not in known or unit != found[0]:
            raise TruthError(
                f"{lines.where(cell=column + 1)}: the unit {unit[:40]!r} must be {right}, the same "
                f"for the three axes"
            )
    return found[0], known[found[0]]


def _name(cell: str) -> str:
    name = " ".join(cell.split())
    if name.lower().startswith(_PREFIX):
        name = name[len(_PREFIX) :]
    subject, colon, segment = name.partition(":")
    # Tracker writes each object's name twice.
    if colon and subject.strip() == segment.strip():
        name = subject.strip()
    return name
