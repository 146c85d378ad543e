"""Reader for trajectories whose samples have their own times: plain CSV, EuRoC's, and TUM.

Plain CSV: columns ``t,x,y,z`` and, if known, ``qx,qy,qz,qw``, in any order, with a header, in
seconds and metres unless the header names a unit (``x_mm``, ``t [ms]``); a column ``body``
distinguishes several bodies. Times that count from 1970 in smaller units than seconds, as of
ORB-SLAM's trajectories, are recognised. EuRoC's ground truth is such a CSV with its own titles,
``p_RS_R_x [m]`` and ``q_RS_w []``, and integer nanoseconds; those counted from 1970 are read to
within half a microsecond, the resolution of a float. TUM: ``t tx ty tz qx qy qz qw`` separated by
spaces, without a header.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.errors import TruthError
from observer.geometry import Float64Array
from observer.truth.files.angles import quaternion_rotations
from observer.truth.files.body_names import BodyNames
from observer.truth.files.number_rows import NumberRows, cells_of, read_numbers
from observer.truth.files.text_lines import TextLines, separator_of
from observer.truth.files.units import (
    LENGTHS_M,
    LONG_STEP_S,
    LONGEST_STEP_S,
    MOST_METRES,
    MOST_SECONDS,
    ROOM_M,
    TIMES_S,
    length_word,
    time_unit,
    time_word,
    too_far_for_a_room,
)
from observer.truth.motion_capture import SAME_INSTANT_S, Capture, Trajectory

_TUM = ("t", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
_POSITION = ("x", "y", "z")
_TURN = ("qx", "qy", "qz", "qw")
_ALIASES = {"time": "t", "timestamp": "t", "tx": "x", "ty": "y", "tz": "z", "name": "body"}
# A title and its unit, as in x_mm, x [mm] or x (mm).
_TITLE = re.compile(r"^([a-z]+)(?:_(mm|cm|m|ms|us|ns|s)|\s*[\[(]\s*([a-z]+)\s*[\])])?$")
# Titles of EuRoC's ground truth, whose time is in nanoseconds.
_EUROC_TITLE = re.compile(r"^(?:p_rs_r_([xyz])|q_rs_([wxyz]))\s*(?:\[\s*([a-z]*)\s*\])?$")
# Name of the body if the file has none.
_ONLY_BODY = "body"
# Fewer times may be poses at which something stood, however far apart.
_FEWEST_REFUSED = 10
# Columns of the project's own truth.csv, which has x, y, z and t as well.
_OWN = {"frame", "t", "id", "x", "y", "z", "vx", "vy", "vz", "visible"}


def is_own_truth(first_line: str) -> bool:
    """Return whether a file with this first line is the project's own ``truth.csv``."""
    cells = first_line.split(separator_of(first_line))
    return {_bare(cell) for cell in cells} >= _OWN


def is_plain_csv(first_line: str) -> bool:
    """Return whether a file with this first line is a plain CSV with a header."""
    cells = first_line.split(separator_of(first_line))
    titles = {title for title, _ in map(_understood_title, cells)}
    return titles >= {"t", *_POSITION}


def is_tum(line: str) -> bool:
    """Return whether a file is a TUM trajectory, by its first line that is not a comment."""
    cells = line.split()
    return len(cells) == len(_TUM) and all(map(_is_number, cells))


def read_plain_csv(lines: TextLines) -> Capture:
    """Read every body of a plain CSV, or the one of EuRoC's ground truth.

    Times are the file's, in seconds; samples that repeat a time are left out, with a note.

    Raises:
        TruthError: one sentence naming the line, the cell and the reason.
    """
    first = lines.next() or ""
    separator = separator_of(first)
    cells = cells_of(lines, first, separator)
    titles = [_understood_title(cell) for cell in cells]
    euroc = any(_EUROC_TITLE.match(_bare(cell)) for cell in cells)
    if euroc:
        titles = [("t", "ns") if each == ("t", None) else each for each in titles]
    columns = _columns(lines, titles)
    scales = [_scale(lines, titles, index) for index in range(len(titles))]
    labels = [" ".join(cell.split())[:40] or f"column {k}" for k, cell in enumerate(cells, 1)]
    names_in, used = columns.get("body"), sorted(columns.values())
    rows = read_numbers(lines, labels, separator=separator, names_in=names_in, only=used)
    unit = titles[columns["x"]][1]
    turn = [columns[title] for title in _TURN if title in columns]
    bodies = rows.column(columns["body"]) if "body" in columns else np.zeros(rows.count)
    stamped = titles[columns["t"]][1]
    table = _Table(
        lines.name,
        rows,
        rows.column(columns["t"]) * scales[columns["t"]],
        rows.columns([columns[axis] for axis in _POSITION]) * scales[columns["x"]],
        rows.columns(turn) if turn else None,
    )
    if stamped is None:
        table.detect_time_unit()
    found = {}
    names = BodyNames(lines.name)
    for number, label in enumerate(rows.names or [_ONLY_BODY]):
        name = names.of(label)
        found[name] = table.trajectory(name, bodies == number)
    notes = [f"positions are in {length_word(unit or 'm')}", *table.notes]
    farthest = float(np.nanmax(np.abs(table.positions), initial=0.0))
    if unit is None and farthest > ROOM_M:
        notes.append(
            f"{too_far_for_a_room(f'{farthest:.4g} m')}: the file seems to use a smaller unit; "
            "name it in the header, as in x_mm,y_mm,z_mm"
        )
    return Capture("EuRoC ground truth" if euroc else "plain CSV", None, found, tuple(notes))


def read_tum(lines: TextLines) -> Capture:
    """Read the one body of a TUM trajectory; samples that repeat a time are left out.

    Raises:
        TruthError: one sentence naming the line, the cell and the reason.
    """
    rows = read_numbers(lines, _TUM, separator=None)
    places, turns = rows.columns((1, 2, 3)), rows.columns((4, 5, 6, 7))
    table = _Table(lines.name, rows, rows.column(0), places, turns)
    table.detect_time_unit()
    body = table.trajectory(_ONLY_BODY, np.ones(rows.count, dtype=np.bool_))
    notes = ("positions are in metres", *table.notes)
    return Capture("TUM trajectory", None, {_ONLY_BODY: body}, notes)


@dataclass(eq=False)
class _Table:
    """Rows of a file: times (N,) s, positions (N, 3) m, quaternions (N, 4) or None.

    Attributes:
        repeated: number of samples left out so far because they repeat the time before them.
        unit: in which the file's times turned out to be.
        step_s: median time between samples, where the file states no unit.
    """

    file: str
    rows: NumberRows
    times: Float64Array
    positions: Float64Array
    turns: Float64Array | None
    repeated: int = 0
    unit: str = "s"
    step_s: float = 0.0

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about samples that were left out, and about the unit of the times."""
        notes = []
        if self.unit != "s":
            notes.append(f"times are in {time_word(self.unit)} since 1970")
        if self.step_s >= LONG_STEP_S:
            notes.append(
                f"samples are {self.step_s:.4g} s apart: if their times are not in seconds, give "
                "them as CSV with a header that names their unit, as in t_ms"
            )
        if self.repeated == 1:
            notes.append("1 sample with a repeated time is ignored")
        elif self.repeated:
            notes.append(f"{self.repeated} samples with a repeated time are ignored")
        return tuple(notes)

    def detect_time_unit(self) -> None:
        """Convert times that count from 1970 in a smaller unit to seconds.

        Raises:
            TruthError: they are in another unit than seconds, from another moment.
        """
        self.unit = time_unit(self.times)
        self.times = self.times * TIMES_S[self.unit]
        moments = np.unique(self.times[np.isfinite(self.times)])
        self.step_s = float(np.median(np.diff(moments))) if len(moments) > 1 else 0.0
        if self.step_s >= LONGEST_STEP_S and len(moments) >= _FEWEST_REFUSED:
            raise TruthError(
                f"{self.file}: the times are {self.step_s:.4g} s apart, so they seem to be in a "
                "smaller unit than seconds; give them in seconds, or as CSV with a header that "
                "names their unit, as in t_ms"
            )

    def trajectory(self, name: str, its: NDArray[np.bool_]) -> Trajectory:
        """Return the trajectory of one body's rows.

        Raises:
            TruthError: there are none, times decrease, or numbers are not a pose.
        """
        if not its.any():
            raise TruthError(f"{self.file}: it contains no data rows")
        at = np.flatnonzero(its)
        lost = ~(np.abs(self.times[at]) <= MOST_SECONDS)
        self.rows.refuse(at[lost], f"the time must be given and at most {MOST_SECONDS:g} s")
        steps = np.append(np.inf, np.diff(self.times[at]))
        self.rows.refuse(at[steps < 0], f"the time is earlier than the previous one of {name}")
        self.repeated += int(np.count_nonzero(steps <= SAME_INSTANT_S))
        at = at[steps > SAME_INSTANT_S]
        times, positions = self.times[at], self.positions[at]
        known = np.isfinite(positions)
        partial = known.any(axis=1) & ~known.all(axis=1)
        self.rows.refuse(at[partial], "x, y and z must all be given, or none of them")
        far = (np.abs(positions) > MOST_METRES).any(axis=1)
        self.rows.refuse(at[far], f"x, y and z must be within {MOST_METRES:g} m")
        matrices = None
        if self.turns is not None:
            turns = self.turns[at]
            turns[~known.all(axis=1)] = np.nan
            matrices, wrong = quaternion_rotations(turns)
            self.rows.refuse(at[wrong], "qx, qy, qz, qw must be a unit quaternion")
        return Trajectory(name, times, positions, matrices)


def _columns(lines: TextLines, titles: Sequence[tuple[str, str | None]]) -> dict[str, int]:
    """Return the indices of the used columns, by title."""
    columns: dict[str, int] = {}
    for index, (title, _) in enumerate(titles):
        if title in ("t", "body", *_POSITION, *_TURN):
            if title in columns:
                raise TruthError(f"{lines.where(cell=index + 1)}: {title} appears twice")
            columns[title] = index
    some = [title for title in _TURN if title in columns]
    if some and len(some) != len(_TURN):
        raise TruthError(f"{lines.where()}: {some[0]} is given, but not all of qx, qy, qz, qw")
    if len({titles[columns[axis]][1] or "m" for axis in _POSITION}) > 1:
        raise TruthError(f"{lines.where()}: x, y and z must be in the same unit")
    return columns


def _scale(lines: TextLines, titles: Sequence[tuple[str, str | None]], index: int) -> float:
    """Return the factor from a column's unit to seconds or metres."""
    title, unit = titles[index]
    known = TIMES_S if title == "t" else LENGTHS_M if title in _POSITION else None
    if known is None or unit is None:
        return 1.0
    if unit not in known:
        raise TruthError(
            f"{lines.where(cell=index + 1)}: the unit {unit[:20]!r} of {title} must be one of "
            f"{', '.join(known)}"
        )
    return known[unit]


def _understood_title(cell: str) -> tuple[str, str | None]:
    """Return a column's title and its unit, if it names one."""
    euroc = _EUROC_TITLE.match(_bare(cell))
    if euroc is not None:
        return euroc[1] or f"q{euroc[2]}", euroc[3] or None
    found = _TITLE.match(_bare(cell))
    if found is None:
        return "", None
    title = found[1]
    return _ALIASES.get(title, title), found[2] or found[3]


def _bare(cell: str) -> str:
    return cell.strip(" \t\"'#").lower()


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
