"""Live motion capture as it is told."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, Field


class CaptureBody(BaseModel):
    name: str
    role: Literal["observer", "obstacle"] | None
    rate_hz: float


class ServerClock(BaseModel):
    """The server's clock against the host's."""

    offset_s: float
    drift_ppm: float | None = Field(description="None: too short a time was seen.")
    sigma_s: float
    samples: int


class LiveAlignment(BaseModel):
    offset_s: float = Field(description="Delay of motion capture behind the frames.")
    sigma_s: float
    drift_ppm: float
    correlation: float
    overlap_s: float
    residual_mps: float
    samples: int
    observer: str | None
    frame_residual_m: float | None
    matches: dict[str, str | None] = Field(description="The body of each SEGMENT:TRACK.")
    notes: list[str]


class LiveTruthStatus(BaseModel):
    """Live motion capture that is listened to."""

    spec: str
    observer: str | None
    ignore: list[str]
    state: Literal["connecting", "receiving", "waiting"]
    trouble: str | None
    notes: list[str]
    bodies: list[CaptureBody]
    clock: ServerClock | None
    aligned: bool
    sentence: str = Field(description="How it is aligned, or why it is not yet.")
    alignment: LiveAlignment | None
