"""State of a live motion-capture connection, whatever its protocol."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from observer.truth.live.clock import ClockFit

LiveState = Literal["connecting", "receiving", "waiting"]

MOST_KEPT = 10_000
MOST_BODIES = 200


@dataclass(frozen=True)
class LiveCaptureReport:
    """State of a connection.

    Attributes:
        state: ``connecting`` (no server is reached), ``waiting`` (reached, but no pose came within
            the last second) or ``receiving``.
        trouble: one sentence for people about what is wrong now; None if nothing is.
        notes: one sentence each about what was noticed so far (ticks, jumps, scale).
        rate_hz: samples per second of each body over the last seconds, including gaps.
        seen: share of each body's samples that had a pose, from 0 to 1, over the same time.
        dropped: samples lost because nobody drained them.
        malformed: messages that could not be read. connections: made so far.
        clock: server to host; None before enough samples have arrived.
    """

    state: LiveState
    trouble: str | None
    notes: tuple[str, ...]
    rate_hz: Mapping[str, float]
    seen: Mapping[str, float]
    dropped: int
    malformed: int
    connections: int
    clock: ClockFit | None
