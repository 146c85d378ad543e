"""Matches tracks to bodies by position, unless a person decides."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from observer.geometry import Float64Array
from observer.truth.alignment.observed import TrackKey

# Metres: largest median distance of a track from its body; the body's origin and the middle of its
# visible part may be half a robot apart.
GATE_M = 1.0
# Seconds: tracks of one body succeed each other, but may overlap for this long.
_TOGETHER_S = 0.5


@dataclass(frozen=True)
class Match:
    """The body matched to a track.

    Attributes:
        body: its name, None if the track belongs to none.
        by: ``position``, ``speed`` or ``person``.
        distance_m: median over the track's life; None if it is unknown.
    """

    body: str | None
    by: str
    distance_m: float | None


def match_tracks(
    lives: Mapping[TrackKey, tuple[float, float]],
    distances: Mapping[TrackKey, Mapping[str, float]],
    corrections: Mapping[TrackKey, str | None],
) -> dict[TrackKey, Match]:
    """Match tracks to bodies: a body has one track at a time, or several in succession.

    Args:
        lives: first and last time of each track, seconds.
        distances: for each track the median distance from each body, metres; NaN where unknown.
        corrections: a person's decisions, which take precedence.
    """
    matched: dict[TrackKey, Match] = {}
    taken: dict[str, list[tuple[float, float]]] = {}
    for key, body in corrections.items():
        if key in lives:
            distance = distances.get(key, {}).get(body, np.nan) if body is not None else np.nan
            known = float(distance) if np.isfinite(distance) else None
            matched[key] = Match(body, "person", known)
            if body is not None:
                taken.setdefault(body, []).append(lives[key])
    candidates = sorted(
        (distance, str(key), key, body)
        for key, by_body in distances.items()
        for body, distance in by_body.items()
        if key not in matched and np.isfinite(distance) and distance <= GATE_M
    )
    # Surest first: long tracks near a body, so that a short ghost track displaces none.
    candidates.sort(key=lambda c: c[0] / max(lives[c[2]][1] - lives[c[2]][0], 0.1))
    for distance, _, key, body in candidates:
        if key in matched or any(_together(lives[key], other) for other in taken.get(body, ())):
            continue
        nearest = min(v for v in distances[key].values() if np.isfinite(v))
        # A track near two bodies belongs to the nearer one or to none.
        if distance > nearest + 0.2:
            continue
        matched[key] = Match(body, "position", float(distance))
        taken.setdefault(body, []).append(lives[key])
    for key in lives:
        matched.setdefault(key, Match(None, "position", None))
    return {key: matched[key] for key in lives}


def median_distance(seen: Float64Array, true: Float64Array) -> float:
    """Return the median distance of positions (N, 3); NaN with fewer than three known on both."""
    distance = np.linalg.norm(seen - true, axis=1)
    known = distance[np.isfinite(distance)]
    return float(np.median(known)) if len(known) >= 3 else float("nan")


def _together(a: tuple[float, float], b: tuple[float, float]) -> bool:
    return min(a[1], b[1]) - max(a[0], b[0]) > _TOGETHER_S
