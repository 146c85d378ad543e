"""Messages to and from the worker: plain frozen dataclasses, sent as pickles."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Picture:
    """Request for a small picture of what a source shows.

    Attributes:
        spec: spec of a simulated scenario or of a folder with images.
    """

    spec: str


@dataclass(frozen=True)
class Pictured:
    """Small JPEG of the left image."""

    jpeg: bytes
