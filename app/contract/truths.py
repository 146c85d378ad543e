"""Ground-truth files, as reported to clients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from app.contract.values import means
from observer.truth.files.known import AngleReading


@dataclass(frozen=True)
class TruthBody:
    """One body, as it was read."""

    name: str
    has_orientation: bool
    samples: int
    seen: Annotated[int, means("Number of samples in which it was seen.")]
    gaps: int
    from_s: Annotated[float | None, means("On the motion-capture system's clock, as is to_s.")]
    to_s: float | None
    extent_m: Annotated[Sequence[float] | None, means("Along the room's three axes.")]
    highest_speed_mps: Annotated[float | None, means("Smoothed over 11 samples.")]


@dataclass(frozen=True)
class TruthReading:
    """Options with which the file was read; null: as the file states."""

    rate_hz: float | None
    angles: AngleReading | None


@dataclass(frozen=True)
class TruthInfo:
    format: str
    rate_hz: float | None
    duration_s: Annotated[float | None, means("Over all bodies together.")]
    bodies: Sequence[TruthBody]
    notes: Sequence[str]
    reading: TruthReading


@dataclass(frozen=True)
class TruthEntry:
    """A ground-truth file."""

    id: Annotated[str, means("SHA-256 of its content.")]
    name: str
    format: Annotated[str, means("Detected format.")]
    info: Annotated[
        TruthInfo,
        means("Contents of the file: rate_hz, duration_s, bodies, notes, and the reading options."),
    ]
    created_at: str
