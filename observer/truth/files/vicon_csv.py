"""Reader for Vicon's CSV files: Tracker's Objects and Segments, Nexus' Trajectories and Segments.

A file is a list of sections, separated by empty lines; each has a title, the rate, the names, the
columns (``Frame,Sub Frame,...``), the units, and the samples. Devices and other sections of Nexus
(model outputs, joints, events) are skipped. Tracker 3.5 omits the rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from observer.errors import TruthError
from observer.geometry import Float64Array
from observer.truth.files.angles import (
    find_reading,
    quaternion_rotations,
    rotations,
)
from observer.truth.files.body_names import BodyNames
from observer.truth.files.known import AngleReading
from observer.truth.files.number_rows import NumberRows, cells_of, read_numbers
from observer.truth.files.text_lines import TextLines, separator_of
from observer.truth.files.units import FASTEST_HZ, MOST_METRES, MOST_RADIANS, length_word
from observer.truth.files.vicon_columns import BodyColumns, body_columns, is_frame_row
from observer.truth.motion_capture import Capture, Trajectory

_READ = {"objects": "Tracker objects", "segments": "segments", "trajectories": "Nexus trajectories"}
_SKIPPED = ("devices", "joints", "model outputs", "events")
# Title, rate, names, columns.
_HEADER_ROWS = 4
# Larger frame numbers are not exact as floats.
_MOST_FRAME = 2.0**53
# No motion capture is slower; a smaller number in place of the rate is the number of objects.
_SLOWEST_HZ = 10.0
_EMPTY = " \t,;"


def is_vicon_csv(first_lines: Sequence[str]) -> bool:
    """Return whether a text with these first lines is one of Vicon's."""
    if not first_lines:
        return False
    separator = separator_of("".join(first_lines))
    rows = [line.split(separator) for line in first_lines[:_HEADER_ROWS]]
    return _title(rows[0]) in (*_READ, *_SKIPPED) or any(map(is_frame_row, rows))


def read_vicon_csv(
    lines: TextLines, *, rate_hz: float | None = None, angles: AngleReading | None = None
) -> Capture:
    """Read every body and marker of the file.

    Times are seconds since the system's frame 1.

    Args:
        rate_hz: overrides the file's. angles: their reading; None detects it.

    Raises:
        TruthError: one sentence naming the line, the cell and the reason.
        AnglesUnclear: only a person can decide how the angles are to be read.
    """
    separator = separator_of("".join(lines.peek(_HEADER_ROWS)))
    found = _Found(lines, separator, rate_hz, BodyNames(lines.name))
    while (line := lines.next()) is not None:
        if line.strip(_EMPTY):
            _read_section(line, found)
    if not found.sections:
        raise TruthError(
            f"{lines.name}: it contains only {' and '.join(found.skipped)}; export Objects, "
            "Segments or Trajectories"
        )
    notes = list(dict.fromkeys(found.notes))
    if found.skipped:
        notes.append(f"ignored, because it contains no positions: {', '.join(found.skipped)}")
    if found.angles:
        if angles is None:
            angles, why = find_reading(lines.name, found.angles)
            notes.append(why)
        else:
            notes.append(f"angles are read as {angles.replace('_', ' ')}, as requested")
        for name, turned in found.angles.items():
            body = found.bodies[name]
            found.bodies[name] = Trajectory(
                name, body.times, body.positions, rotations(turned, angles)
            )
    rate = found.rates.pop() if len(found.rates) == 1 else None
    words = " and ".join(dict.fromkeys(found.sections))
    return Capture(f"Vicon {words}", rate, found.bodies, tuple(notes))


@dataclass(eq=False)
class _Found:
    """Content of the sections read so far."""

    lines: TextLines
    separator: str
    rate_hz: float | None
    names: BodyNames
    sections: list[str] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)
    rates: set[float] = field(default_factory=set)
    bodies: dict[str, Trajectory] = field(default_factory=dict)
    # (N, 3) radians, of bodies whose rotations are still to be computed.
    angles: dict[str, Float64Array] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def _read_section(first: str, found: _Found) -> None:
    lines = found.lines
    header = [cells_of(lines, first, found.separator)]
    title = _title(header[0])
    if title in _SKIPPED:
        while (line := lines.next()) is not None and line.strip(_EMPTY):
            pass
        found.skipped.append(title.capitalize())
        return
    while len(header) < _HEADER_ROWS and not is_frame_row(header[-1]):
        line = lines.next()
        if line is None:
            break
        header.append(cells_of(lines, line, found.separator))
    if not is_frame_row(header[-1]):
        raise TruthError(
            f"{lines.where()}: a section must start with its title, such as Objects or "
            f"Trajectories, and have a row with Frame,Sub Frame within its first {_HEADER_ROWS} "
            f"rows, but this section starts with {title[:40]!r}"
        )
    units = cells_of(lines, lines.next() or "", found.separator)
    names = header[-2] if len(header) > 1 else []
    columns = body_columns(lines, names, header[-1], units, found.names)
    rate = _rate(header[1:-2], len(columns), found)
    labels = ["Frame", "Sub Frame"]
    for body in columns:
        labels += body.labels
    rows = read_numbers(lines, labels, separator=found.separator, short=True, sections=True)
    if not rows.count:
        raise TruthError(f"{lines.name}: the section {title.capitalize()[:40]} contains no samples")
    times = _times(rows, rate)
    found.sections.append(_READ.get(title, "table"))
    found.rates.add(rate)
    for body in columns:
        _add_body(body, rows, times, found)
    for unit in dict.fromkeys(body.unit for body in columns):
        found.notes.append(f"positions are in {length_word(unit)}")


def _rate(rows: Sequence[Sequence[str]], bodies: int, found: _Found) -> float:
    """Return the rate, 1/s, as requested or from the rows between the title and the names."""
    name = found.lines.name
    rate_hz = next((value for row in rows if (value := _number(row)) is not None), None)
    if rate_hz is not None and rate_hz == bodies and rate_hz < _SLOWEST_HZ:
        # Some versions write the number of objects there.
        rate_hz = None
    if found.rate_hz is not None:
        if rate_hz is not None and rate_hz != found.rate_hz:
            found.notes.append(
                f"the rate is {found.rate_hz:g} Hz as requested, although the file says "
                f"{rate_hz:g} Hz"
            )
        rate_hz = found.rate_hz
    if rate_hz is None:
        raise TruthError(
            f"{name}: the file does not state its frame rate (Tracker 3.5 omits it); give the "
            "frame rate of the capture system in Hz"
        )
    if not 0 < rate_hz <= FASTEST_HZ:
        raise TruthError(
            f"{name}: the frame rate must be above 0 and at most {FASTEST_HZ:g} Hz, not {rate_hz:g}"
        )
    return rate_hz


def _times(rows: NumberRows, rate: float) -> Float64Array:
    frames = rows.column(0)
    wrong = ~((frames >= 0) & (frames <= _MOST_FRAME) & (frames == np.floor(frames)))
    rows.refuse(
        np.flatnonzero(wrong),
        lambda row: f"Frame must be a whole number of at least 0, not {frames[row]:g}",
        cell=1,
    )
    divided = np.flatnonzero(np.nan_to_num(rows.column(1)))
    rows.refuse(divided, "Sub Frame must be 0, as positions are given once per frame", cell=2)
    times = (frames - 1) / rate
    rows.refuse(
        np.flatnonzero(np.diff(times) <= 0) + 1,
        lambda row: (
            f"frame {frames[row]:.0f} does not follow frame {frames[row - 1]:.0f} of the previous "
            "line; export one trial at a time"
        ),
        cell=1,
    )
    return np.asarray(times)


def _add_body(body: BodyColumns, rows: NumberRows, times: Float64Array, found: _Found) -> None:
    positions = rows.columns(body.position)
    positions *= body.position_scale
    turned = rows.columns(body.rotation)
    turned *= body.rotation_scale
    known = np.isfinite(positions)

    def refuse(wrong: NDArray[np.bool_] | np.bool_, why: str) -> None:
        cell = (body.rotation or body.position)[0] + 1
        rows.refuse(np.flatnonzero(wrong), f"of {body.name}, {why}", cell)

    partial = known.any(axis=1) & ~known.all(axis=1)
    refuse(partial, "its position must be given in all three axes or in none")
    far = (np.abs(positions) > MOST_METRES).any(axis=1)
    refuse(far, f"its position must be within {MOST_METRES:g} m")
    beyond = (np.abs(turned) > MOST_RADIANS).any(axis=1)
    refuse(beyond, f"its angles must be within {MOST_RADIANS:g} rad")
    # Exact zeros in all axes are no measurement: some exports write them for gaps.
    lost = (positions == 0).all(axis=1) & (turned[:, :3] == 0).all(axis=1)
    if lost.any():
        found.notes.append("samples in which all numbers are exactly 0 are treated as gaps")
    lost |= ~known.all(axis=1)
    positions[lost] = np.nan
    turned[lost] = np.nan
    matrices = None
    if body.kind == "quaternion":
        matrices, wrong = quaternion_rotations(turned)
        refuse(wrong, "RX, RY, RZ, RW must be a unit quaternion")
    elif body.kind == "helical or euler":
        found.angles[body.name] = turned
    found.bodies[body.name] = Trajectory(body.name, times, positions, matrices)


def _title(cells: Sequence[str]) -> str:
    return cells[0].strip(_EMPTY + '"').lower() if cells else ""


def _number(cells: Sequence[str]) -> float | None:
    try:
        return float(cells[0].strip().replace("_", "?").replace(",", "."))
    except (ValueError, IndexError):
        return None
