"""Opens any truth file as truth of observed frames: already aligned, or aligned here."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from observer.truth.alignment.aligned import AlignedTruth
from observer.truth.alignment.alignment import align
from observer.truth.alignment.choices import AlignmentChoices
from observer.truth.alignment.observed import ObservedRun
from observer.truth.alignment.result import Alignment
from observer.truth.contract import Truth
from observer.truth.csv_file import CsvTruth
from observer.truth.files.known import AngleReading
from observer.truth.files.recognition import file_kind, read_capture
from observer.truth.motion_capture import Capture


@dataclass(frozen=True, eq=False)
class OpenedTruth:
    """Ground truth that frames can be compared with.

    Attributes:
        truth: on the frames' clock and in their world.
        capture, alignment: what it was made from; None for ``truth.csv``, which needs neither.
    """

    truth: Truth
    capture: Capture | None = None
    alignment: Alignment | None = None


def open_truth(
    path: Path | str,
    lines: Iterable[Mapping[str, Any]],
    choices: AlignmentChoices | None = None,
    *,
    rate_hz: float | None = None,
    angles: AngleReading | None = None,
) -> OpenedTruth:
    """Read a truth file, recognised by its content, and align it with what was observed.

    Args:
        lines: of ``observe``, as plain dictionaries; used only if alignment is needed.
        rate_hz, angles: as for ``read_capture``.

    Raises:
        TruthError: the file cannot be read, or cannot be aligned; one sentence.
    """
    if file_kind(path) == "truth.csv":
        return OpenedTruth(CsvTruth(path))
    capture = read_capture(path, rate_hz=rate_hz, angles=angles)
    alignment = align(ObservedRun.of_lines(lines), capture, choices)
    return OpenedTruth(AlignedTruth(capture, alignment), capture, alignment)
