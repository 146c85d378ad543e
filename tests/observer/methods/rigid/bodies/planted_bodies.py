"""Prescribed paths for bodies of known points."""

from __future__ import annotations

from typing import Any

from observer.methods.rigid.bodies.body import BodyTrack
from observer.types import TrackState

SIZE = (0.4, 0.3, 0.5)
# Seconds between two frames.
DT = 1 / 15


def to_the_right(speed: float = 0.4, x: float = -0.6, z: float = 3.0) -> Any:
    return lambda t: ((x + speed * t, 0.0, z), 0.3)


def alive(tracks: list[BodyTrack]) -> list[BodyTrack]:
    return [t for t in tracks if t.state is not TrackState.TENTATIVE]
