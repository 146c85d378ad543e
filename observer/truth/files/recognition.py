"""Reader for motion capture files of all known formats, detected by content, not by name."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO, Literal

from observer.errors import TruthError
from observer.truth.files.c3d_file import is_c3d, read_c3d
from observer.truth.files.known import AngleReading, CaptureKind, understood_in_words
from observer.truth.files.motive_csv import is_motive, read_motive
from observer.truth.files.text_lines import TextLines
from observer.truth.files.timed_poses import (
    is_own_truth,
    is_plain_csv,
    is_tum,
    read_plain_csv,
    read_tum,
)
from observer.truth.files.vicon_csv import is_vicon_csv, read_vicon_csv
from observer.truth.motion_capture import Capture

FileKind = CaptureKind | Literal["truth.csv"]

# Lines that identify a text file; in a TUM file comments may precede them.
_LOOKED_AT = 8
_MOST_COMMENTS = 100
_HEAD_BYTES = 1024
# Beginning of TRC files, tables of marker positions that OpenSim and others write.
_TRC = "PathFileType"


def file_kind(path: Path | str) -> FileKind:
    """Detect a file's kind; ``truth.csv`` is for ``CsvTruth``, all others for ``read_capture``.

    Raises:
        TruthError: it cannot be read, or has none of the known formats.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            # Keep the lines alive until the file is closed: their deletion would close it, too.
            kind, _lines = _kind(file, path.name)
            return kind
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from None


def read_capture(
    path: Path | str,
    *,
    rate_hz: float | None = None,
    angles: AngleReading | None = None,
) -> Capture:
    """Read a whole motion capture file, in metres, seconds and its own room frame.

    Args:
        rate_hz: overrides the file's rate, or replaces a missing one (Vicon Tracker 3.5); ignored
            for files whose samples have their own times.
        angles: reading of Vicon's three angles; None detects it.

    Raises:
        TruthError: one sentence naming the file, the line, the cell and the reason, or the file
            is the project's own ``truth.csv``.
        AnglesUnclear: the angles can be read in two ways, and only a person can decide.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            kind, lines = _kind(file, path.name)
            capture = _read(kind, lines, path, rate_hz, angles)
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from None
    notes = list(capture.notes)
    if rate_hz is not None and kind in ("plain csv", "tum", "motive csv"):
        notes.append(
            f"the given rate of {rate_hz:g} Hz is ignored because the samples have their own times"
        )
    if lines is not None and not lines.is_unicode:
        notes.append("the text is not Unicode and is read as Windows-1252")
    notes += _gaps(capture)
    return Capture(capture.format, capture.rate_hz, capture.bodies, tuple(notes))


def _read(
    kind: FileKind,
    lines: TextLines | None,
    path: Path,
    rate_hz: float | None,
    angles: AngleReading | None,
) -> Capture:
    if lines is None:
        return read_c3d(path, path.name, rate_hz=rate_hz)
    if kind == "vicon csv":
        return read_vicon_csv(lines, rate_hz=rate_hz, angles=angles)
    if kind == "motive csv":
        return read_motive(lines)
    if kind == "plain csv":
        return read_plain_csv(lines)
    if kind == "tum":
        return read_tum(lines)
    raise TruthError(
        f"{path.name}: this is ground truth in the observer's own world frame and on its clock, as "
        "written by simulate; it needs no alignment, so give it as ground truth and not as motion "
        "capture"
    )


def _kind(file: BinaryIO, name: str) -> tuple[FileKind, TextLines | None]:
    head = file.read(_HEAD_BYTES)
    file.seek(0)
    if not head.strip():
        raise TruthError(f"{name}: the file is empty; {understood_in_words()}")
    if is_c3d(head):
        return "c3d", None
    if head.startswith(b"PK\x03\x04"):
        raise TruthError(
            f"{name}: this is a ZIP archive or a spreadsheet; unpack it, or save it as CSV"
        )
    lines = TextLines(file, name)
    first = lines.peek(_LOOKED_AT)
    while first and not first[0].strip(" \t,;"):
        lines.next()
        first = lines.peek(_LOOKED_AT)
    if not first:
        raise TruthError(f"{name}: the file contains only empty lines; {understood_in_words()}")
    if is_own_truth(first[0]):
        return "truth.csv", lines
    if first[0].lstrip().startswith(_TRC):
        raise TruthError(
            f"{name}: a TRC file contains single markers without bodies; export rigid bodies or "
            "segments as CSV, or C3D"
        )
    if is_motive(first[0]):
        return "motive csv", lines
    if is_vicon_csv(first):
        return "vicon csv", lines
    if is_plain_csv(first[0]):
        return "plain csv", lines
    first_data = next(
        (line for line in lines.peek(_MOST_COMMENTS) if line.strip() and line.lstrip()[0] != "#"),
        first[0],
    )
    if is_tum(first_data):
        return "tum", lines
    raise TruthError(
        f"{name}: not a known motion-capture format (it starts with {first[0].strip()[:60]!r}); "
        f"{understood_in_words()}"
    )


def _gaps(capture: Capture) -> list[str]:
    gaps = sum(body.gaps for body in capture.bodies.values())
    if not gaps:
        return ["all bodies are tracked in every sample, without gaps"]
    number = sum(1 for body in capture.bodies.values() if body.gaps)
    samples = sum(len(body.times) for body in capture.bodies.values())
    return [
        f"gaps: {gaps} of {samples} samples are missing, in {number} of {len(capture.bodies)} "
        "bodies"
    ]


def _unreadable(path: Path, error: OSError | ValueError) -> TruthError:
    why = getattr(error, "strerror", None) or "its name is not a path"
    return TruthError(f"{str(path)[:200]!r} cannot be read: {why}")
