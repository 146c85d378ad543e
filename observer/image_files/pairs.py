"""Pairs of image files, one for each frame of a sequence."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class FilePair:
    """The files of one frame; times are the exposures on the source's clock, seconds."""

    left: Path
    right: Path
    time: float
    right_time: float | None = None


@dataclass(frozen=True)
class MissingPair:
    """A frame that is known to be missing, and the sentence that says why."""

    reason: str
