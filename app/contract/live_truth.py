"""Live motion capture, as reported to clients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from app.contract.values import means
from observer.rig.rig import Role
from observer.truth.live.contract import LiveState


@dataclass(frozen=True)
class CaptureBody:
    name: str
    role: Role | None
    rate_hz: float


@dataclass(frozen=True)
class ServerClock:
    """The server's clock against the host's."""

    offset_s: float
    drift_ppm: Annotated[float | None, means("null: not observed for long enough yet.")]
    sigma_s: float
    samples: int


@dataclass(frozen=True)
class LiveAlignment:
    offset_s: Annotated[float, means("Delay of motion capture relative to the frames.")]
    sigma_s: float
    drift_ppm: float
    correlation: float
    overlap_s: float
    residual_mps: float
    samples: int
    observer: str | None
    frame_residual_m: float | None
    matches: Annotated[Mapping[str, str | None], means("The body of each SEGMENT:TRACK.")]
    notes: Sequence[str]


@dataclass(frozen=True)
class LiveTruthStatus:
    """State of the live motion capture that the engine listens to."""

    spec: str
    observer: str | None
    ignore: Sequence[str]
    state: LiveState
    trouble: str | None
    notes: Sequence[str]
    bodies: Sequence[CaptureBody]
    clock: ServerClock | None
    aligned: bool
    sentence: Annotated[str, means("How it is aligned, or why it is not aligned yet.")]
    alignment: LiveAlignment | None
