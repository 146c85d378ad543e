"""Reader of rigid bodies in CSV files of OptiTrack Motive, format versions 1.2 and later.

The first line holds keys and values. Header rows follow with each column's type, name, id, kind of
content and axis, then rows with a frame number, its time in seconds and values. Empty cells are
gaps. Motive's room has y up; it is converted to z up, as in Vicon's. Files do not state whether
another axis convention was chosen for the export, so a note says what was assumed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from observer.errors import TruthError
from observer.geometry import Float64Array
from observer.truth.files.angles import euler_rotations, quaternion_rotations
from observer.truth.files.body_names import BodyNames
from observer.truth.files.number_rows import NumberRows, cells_of, read_numbers
from observer.truth.files.text_lines import TextLines, separator_of
from observer.truth.files.units import FASTEST_HZ, MOST_METRES, MOST_RADIANS, MOST_SECONDS
from observer.truth.motion_capture import Capture, Trajectory

_FIRST_KEY = "Format Version"
# By Motive's word: the word for people, and the factor to metres.
_UNITS = {
    "meters": ("metres", 1.0),
    "centimeters": ("centimetres", 0.01),
    "millimeters": ("millimetres", 0.001),
    "inches": ("inches", 0.0254),
    "feet": ("feet", 0.3048),
}
_RIGID_BODY = "rigid body"
_QUATERNION = "Quaternion"
# Axis orders of Motive's Euler angles, which it calls relative: the rotations are intrinsic.
_EULER = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")
_AXES = "xyz"
# Header rows after the first line, including empty ones.
_MOST_HEADER_ROWS = 12
_TIME = 1
# From Motive's axes, y up, to ours, z up; x stays.
_R_ROOM_MOTIVE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def is_motive(first_line: str) -> bool:
    """Return whether a file with this first line is a CSV of Motive."""
    return first_line.startswith((f"{_FIRST_KEY},", f"{_FIRST_KEY};"))


def read_motive(lines: TextLines) -> Capture:
    """Read every rigid body of a file.

    Times are the file's, in seconds since the take began; the room frame has z upwards.

    Raises:
        TruthError: one sentence naming the line, the cell and the reason.
    """
    first = lines.next() or ""
    separator = separator_of(first)
    facts = _Facts.of(lines, cells_of(lines, first, separator))
    header = _header(lines, separator)
    bodies = _bodies(lines, header, facts)
    used = sorted({_TIME, *(column for body in bodies for column in body.used)})
    rows = read_numbers(lines, header.labels, separator=separator, only=used, short=True)
    times = _times(lines, rows)
    names = BodyNames(lines.name)
    found = {}
    for columns in bodies:
        name = names.of(columns.name)
        found[name] = _trajectory(name, rows, times, columns, facts)
    notes = [
        f"positions are in {facts.unit}, rotated from y up (Motive's default) to z up",
        *_left_out(header, used),
    ]
    if facts.euler is not None and any(body.turn for body in bodies):
        notes.append(f"angles are Euler angles {facts.euler} in degrees")
    return Capture("Motive CSV", facts.rate_hz, found, tuple(notes))


@dataclass(frozen=True)
class _Facts:
    """The first line: the unit's word, its factor to metres, the rate, and the rotation type.

    Attributes:
        rotation: the Rotation Type as written. euler: the same if it is one of ``_EULER``, or None.
    """

    unit: str
    metres: float
    rate_hz: float | None
    rotation: str

    @property
    def euler(self) -> str | None:
        return self.rotation if self.rotation in _EULER else None

    @staticmethod
    def of(lines: TextLines, cells: Sequence[str]) -> _Facts:
        # A comma in a take's notes shifts the cells after it, so search for the keys.
        facts = {key.strip(): value.strip() for key, value in pairwise(cells)}
        unit = facts.get("Length Units", "left out")
        if unit.lower() not in _UNITS:
            raise TruthError(
                f"{lines.where()}: Length Units must be {', '.join(_UNITS)}, not {unit[:20]!r}"
            )
        space = facts.get("Coordinate Space", "Global")
        if space != "Global":
            raise TruthError(
                f"{lines.where()}: export with the Coordinate Space Global, not {space[:20]!r}"
            )
        rate = _rate(facts.get("Export Frame Rate", ""))
        return _Facts(*_UNITS[unit.lower()], rate, facts.get("Rotation Type", "left out"))


@dataclass(frozen=True)
class _Header:
    """Meaning of the columns: each sequence has one text per column."""

    types: Sequence[str]
    names: Sequence[str]
    ids: Sequence[str]
    kinds: Sequence[str]
    axes: Sequence[str]

    @property
    def labels(self) -> list[str]:
        """Names of the columns, for messages."""
        parts = zip(self.names, self.kinds, self.axes, strict=True)
        return [" ".join(filter(None, t))[:40] or f"column {k}" for k, t in enumerate(parts, 1)]


@dataclass(frozen=True)
class _Body:
    """Columns of a body: of x, y, z, and of its rotation in the order of its values, if any."""

    name: str
    place: tuple[int, ...]
    turn: tuple[int, ...]

    @property
    def used(self) -> tuple[int, ...]:
        return (*self.place, *self.turn)


@dataclass(eq=False)
class _Axes:
    """Columns of a body found so far, by axis."""

    position: dict[str, int] = field(default_factory=dict)
    rotation: dict[str, int] = field(default_factory=dict)


def _rate(text: str) -> float | None:
    try:
        rate = float(text.replace("_", "?").replace(",", "."))
    except ValueError:
        return None
    return rate if 0 < rate <= FASTEST_HZ else None


def _header(lines: TextLines, separator: str) -> _Header:
    """Read the header up to the row of axes, which starts with Frame."""
    rows: list[list[str]] = []
    for _ in range(_MOST_HEADER_ROWS):
        line = lines.next()
        if line is None:
            break
        cells = [cell.strip() for cell in cells_of(lines, line, separator)]
        if not any(cells):
            continue
        if cells[0] != "Frame":
            rows.append(cells)
            continue
        if len(cells) <= _TIME or not cells[_TIME].startswith("Time"):
            raise TruthError(f"{lines.where(cell=_TIME + 1)}: the column after Frame must be Time")
        if len(rows) < 3:
            raise TruthError(
                f"{lines.where()}: the header rows with types, names and kinds are missing above it"
            )
        width = len(cells)
        # Without a row of ids the third row holds kinds, which do not distinguish bodies.
        ids = _row(rows, "ID", 2, width) if len(rows) > 3 else [""] * width
        return _Header(
            types=[each.lower() for each in _row(rows, "Type", 0, width)],
            names=_row(rows, "Name", 1, width),
            ids=ids,
            kinds=[each.lower() for each in _row(rows, "", len(rows) - 1, width)],
            axes=[each.lower() for each in cells],
        )
    raise TruthError(f"{lines.where()}: the line with Frame and Time is missing")


def _row(rows: Sequence[list[str]], title: str, at: int, width: int) -> list[str]:
    """Return the row with a title, or the one at its index if the version writes no titles."""
    titled = (row for row in rows if title and len(row) > _TIME and row[_TIME] == title)
    row = next(titled, rows[at])
    return [*row[:width], *[""] * (width - len(row))]


def _bodies(lines: TextLines, header: _Header, facts: _Facts) -> list[_Body]:
    """Return the rigid bodies of a header; its last row is the line read last."""
    # Two bodies may share a name, but not an id.
    found: dict[tuple[str, str], _Axes] = {}
    for column in range(_TIME + 1, len(header.axes)):
        kind, axis = header.kinds[column], header.axes[column]
        if header.types[column] != _RIGID_BODY or kind not in ("position", "rotation"):
            continue
        body = found.setdefault((header.names[column], header.ids[column]), _Axes())
        columns = body.position if kind == "position" else body.rotation
        if axis in columns:
            raise TruthError(
                f"{lines.where(cell=column + 1)}: the {kind} {axis.upper()} of "
                f"{header.names[column][:40]!r} appears twice"
            )
        columns[axis] = column
    bodies = []
    for (name, _), axes in found.items():
        if not axes.position.keys() >= set(_AXES):
            raise TruthError(
                f"{lines.where()}: X, Y and Z of the position of {name[:40]!r} must all be there"
            )
        place = tuple(axes.position[axis] for axis in _AXES)
        turn = _turn(lines, name, axes.rotation, facts) if axes.rotation else ()
        bodies.append(_Body(name, place, turn))
    if not bodies:
        raise TruthError(
            f"{lines.name}: it contains no rigid bodies; export with Rigid Bodies, as single "
            "markers and bones are not supported"
        )
    return bodies


def _turn(lines: TextLines, name: str, columns: dict[str, int], facts: _Facts) -> tuple[int, ...]:
    if facts.euler is None and facts.rotation != _QUATERNION:
        raise TruthError(
            f"{lines.name} line 1: export with the Rotation Type Quaternion, not "
            f"{facts.rotation[:20]!r}"
        )
    wanted = "xyzw" if facts.euler is None else facts.euler.lower()
    if columns.keys() != set(wanted):
        raise TruthError(
            f"{lines.where()}: the rotation of {name[:40]!r} must be in the columns "
            f"{', '.join(sorted(wanted.upper()))}, for the Rotation Type is {facts.rotation}"
        )
    return tuple(columns[axis] for axis in wanted)


def _times(lines: TextLines, rows: NumberRows) -> Float64Array:
    if not rows.count:
        raise TruthError(f"{lines.name}: it contains no data rows")
    times = rows.column(_TIME)
    lost = np.flatnonzero(~(np.abs(times) <= MOST_SECONDS))
    rows.refuse(lost, f"the time must be given and at most {MOST_SECONDS:g} s", _TIME + 1)
    late = np.flatnonzero(np.diff(times) <= 0) + 1
    rows.refuse(late, "the time is not later than the previous one", _TIME + 1)
    return times


def _trajectory(
    name: str, rows: NumberRows, times: Float64Array, columns: _Body, facts: _Facts
) -> Trajectory:
    positions = rows.columns(columns.place) * facts.metres
    known = np.isfinite(positions)
    gap = ~known.all(axis=1)
    place = columns.place[0] + 1
    partial = np.flatnonzero(gap & known.any(axis=1))
    rows.refuse(partial, f"X, Y and Z of {name} must all be given, or none of them", place)
    far = np.flatnonzero((np.abs(positions) > MOST_METRES).any(axis=1))
    rows.refuse(far, f"the position of {name} must be within {MOST_METRES:g} m", place)
    matrices: Float64Array | None = None
    if columns.turn:
        turns = rows.columns(columns.turn)
        turns[gap] = np.nan
        cell = columns.turn[0] + 1
        if facts.euler is None:
            matrices, wrong = quaternion_rotations(turns)
            why = f"the rotation of {name} must be a unit quaternion"
        else:
            radians = np.radians(turns)
            wrong = np.asarray((np.abs(radians) > MOST_RADIANS).any(axis=1))
            matrices = euler_rotations(radians, facts.euler)
            why = f"the angles of {name} must be within {np.degrees(MOST_RADIANS):.0f} deg"
        rows.refuse(np.flatnonzero(wrong), why, cell)
        matrices = np.asarray(_R_ROOM_MOTIVE @ matrices)
    return Trajectory(name, times, positions @ _R_ROOM_MOTIVE.T, matrices)


def _left_out(header: _Header, used: Sequence[int]) -> list[str]:
    """Return one sentence on the columns that are not read, if there are any."""
    read = set(used)
    others = [
        header.kinds[column] if each == _RIGID_BODY else each
        for column, each in enumerate(header.types)
        if each and column > _TIME and column not in read
    ]
    if not others:
        return []
    kinds = ", ".join(kind[:30] or "unnamed" for kind, _ in Counter(others).most_common(4))
    columns = "1 column is" if len(others) == 1 else f"{len(others)} columns are"
    return [f"{columns} ignored ({kinds})"]
