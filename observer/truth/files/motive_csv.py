"""Reader of rigid bodies in CSV files of OptiTrack Motive, format versions 1.2 and later.

The first line holds keys and values. Then each column has a type, a name, an id, what it holds and
its axis, one below the other; rows of a frame, its time in seconds and numbers follow. Motive's
room has its y axis upwards; what is read has z upwards, as Vicon's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from observer.errors import TruthError
from observer.geometry import Float64Array
from observer.truth.files.angles import quaternion_rotations
from observer.truth.files.body_names import BodyNames
from observer.truth.files.number_rows import NumberRows, cells_of, read_numbers
from observer.truth.files.text_lines import TextLines
from observer.truth.files.units import MOST_METRES, length_word
from observer.truth.motion_capture import Capture, Trajectory

_FIRST_KEY = "Format Version"
_UNITS = {"meters": "m", "centimeters": "cm", "millimeters": "mm"}
_METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_RIGID_BODY = "rigid body"
_AXES, _TURN = ("x", "y", "z"), ("x", "y", "z", "w")
# Rows of the header behind the first line, with those that are empty.
_MOST_HEADER_ROWS = 12
_FRAME, _TIME = 0, 1
# Motive's axes, y upwards, in ours: x stays, z is upwards.
_R_ROOM_MOTIVE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def is_motive(first_line: str) -> bool:
    """Tell whether a file that begins so is a CSV of Motive."""
    return first_line.startswith(f"{_FIRST_KEY},")


def read_motive(lines: TextLines) -> Capture:
    """Read every rigid body of a file.

    Raises:
        TruthError: one sentence naming the line, the cell and the reason.
    """
    facts = _facts(cells_of(lines, lines.next() or "", ","))
    unit = _UNITS.get(facts.get("Length Units", "").lower())
    if unit is None:
        raise TruthError(
            f"{lines.where()}: Length Units must be {', '.join(_UNITS)}, not "
            f"{facts.get('Length Units', 'left out')[:20]!r}"
        )
    header = _header(lines)
    bodies = header.bodies
    if not bodies:
        raise TruthError(f"{lines.name}: there is no rigid body in it; export rigid bodies")
    if facts.get("Rotation Type", "") != "Quaternion":
        raise TruthError(
            f"{lines.name} line 1: export with the Rotation Type Quaternion, not "
            f"{facts.get('Rotation Type', 'left out')[:20]!r}"
        )
    used = sorted({_TIME, *(column for body in bodies.values() for column in body.used)})
    rows = read_numbers(lines, header.labels, separator=",", only=used, short=True)
    names = BodyNames(lines.name)
    found = {}
    for told, columns in bodies.items():
        name = names.of(told)
        found[name] = _trajectory(name, rows, columns, _METRES[unit])
    # The number of the frame is no column of a body.
    others = header.count - 1 - len(used)
    notes = [f"places are read in {length_word(unit)}, and turned so that z is upwards"]
    if others > 0:
        notes.append(f"{others} columns of markers and qualities are left out")
    return Capture("Motive CSV", _rate(facts), found, tuple(notes))


@dataclass(frozen=True)
class _Columns:
    """Columns of a body: of x y z, and of the quaternion x y z w where there is one."""

    place: tuple[int, ...]
    turn: tuple[int, ...] | None

    @property
    def used(self) -> tuple[int, ...]:
        return (*self.place, *(self.turn or ()))


@dataclass(frozen=True)
class _Header:
    """The header of columns: one label each, and the rigid bodies by what they are called."""

    labels: Sequence[str]
    bodies: Mapping[str, _Columns]

    @property
    def count(self) -> int:
        return len(self.labels)


def _facts(cells: Sequence[str]) -> dict[str, str]:
    return dict(zip(cells[::2], cells[1::2], strict=False))


def _rate(facts: Mapping[str, str]) -> float | None:
    try:
        rate = float(facts.get("Export Frame Rate", ""))
    except ValueError:
        return None
    return rate if 0 < rate < np.inf else None


def _header(lines: TextLines) -> _Header:
    rows: list[list[str]] = []
    for _ in range(_MOST_HEADER_ROWS):
        line = lines.next()
        if line is None:
            break
        cells = [cell.strip() for cell in cells_of(lines, line, ",")]
        if cells and cells[_FRAME] == "Frame":
            return _understood(lines, rows, cells)
        if any(cells):
            rows.append(cells)
    raise TruthError(f"{lines.where()}: the line with Frame and Time is missing")


def _understood(lines: TextLines, rows: list[list[str]], axes: list[str]) -> _Header:
    """Understand the rows above the numbers: types, names, ids and kinds."""
    if len(rows) < 3:
        raise TruthError(f"{lines.where()}: rows of types, names and kinds are missing above it")
    width = len(axes)
    types, names, held = (
        [*row[:width], *[""] * (width - len(row))] for row in (rows[0], rows[1], rows[-1])
    )
    places: dict[str, dict[str, int]] = {}
    turns: dict[str, dict[str, int]] = {}
    for column in range(_TIME + 1, width):
        if types[column].lower() != _RIGID_BODY:
            continue
        kind = {"position": places, "rotation": turns}.get(held[column].lower())
        if kind is not None:
            kind.setdefault(names[column], {}).setdefault(axes[column].lower(), column)
    bodies = {}
    for name, place in places.items():
        if not place.keys() >= set(_AXES):
            raise TruthError(f"{lines.where()}: X, Y and Z of {name[:40]!r} must all be there")
        turn = turns.get(name, {})
        whole = tuple(turn[axis] for axis in _TURN) if turn.keys() >= set(_TURN) else None
        bodies[name] = _Columns(tuple(place[axis] for axis in _AXES), whole)
    labels = [
        " ".join(filter(None, (names[k], held[k], axes[k])))[:40] or f"column {k + 1}"
        for k in range(width)
    ]
    return _Header(labels, bodies)


def _trajectory(name: str, rows: NumberRows, columns: _Columns, metres: float) -> Trajectory:
    times = rows.column(_TIME)
    every = np.arange(rows.count)
    rows.refuse(every[~np.isfinite(times)], "the time must be known", _TIME + 1)
    late = np.append(False, np.diff(times) <= 0)
    rows.refuse(every[late], "the time is not later than that before it", _TIME + 1)
    positions = rows.columns(columns.place) * metres
    far = (np.abs(positions) > MOST_METRES).any(axis=1)
    rows.refuse(every[far], f"places must lie within {MOST_METRES:g} m", columns.place[0] + 1)
    gap = ~np.isfinite(positions).all(axis=1)
    positions[gap] = np.nan
    matrices: Float64Array | None = None
    if columns.turn is not None:
        turns = rows.columns(columns.turn)
        turns[gap] = np.nan
        matrices, wrong = quaternion_rotations(turns)
        rows.refuse(every[wrong], "the rotation must be a unit quaternion", columns.turn[0] + 1)
        matrices = _R_ROOM_MOTIVE @ matrices
    return Trajectory(name, times, positions @ _R_ROOM_MOTIVE.T, matrices)
