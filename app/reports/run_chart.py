"""Chart of one run as plain values, for drawing on a page and for tables."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from itertools import pairwise
from typing import Any

import numpy as np

from app.reports.comparison import alignment_facts
from app.reports.gaps import broken
from app.reports.gathering import Gathered
from observer.evaluation.speed_errors import SeenMotion, speed_errors
from observer.geometry import Float64Array

_OBSTACLE = "obstacle"
# Tenths of a millisecond and of a millimetre per second are finer than a chart shows.
_TIME_DIGITS, _SPEED_DIGITS = 4, 5
CSV_COLUMNS = ("source", "label", "role", "track_id", "body", "segment", "time_s", "speed_mps",
               "std_mps")  # fmt: skip


def chart_values(gathered: Gathered) -> dict[str, Any]:
    """Return the answer of ``GET /api/runs/{id}/chart`` except the run itself.

    A speed of None marks a gap. Times are on the source's clock, seconds.
    """
    alignment = gathered.alignment
    return {
        "aligned": bool(gathered.true),
        "sentence": gathered.truth_words,
        "alignment": None if alignment is None else alignment_facts(alignment),
        "curves": list(_curves(gathered)),
        "changes": list(_changes(gathered.seen)),
        "errors": [asdict(each) for each in speed_errors(gathered.seen, gathered.true)]
        if gathered.true
        else [],
    }


def chart_csv(values: dict[str, Any]) -> str:
    """Return one row for each speed of ``chart_values``; gaps are left out, unknowns are empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    for curve in values["curves"]:
        stds = curve["stds"] or [None] * len(curve["times"])
        fixed = [curve[key] for key in ("kind", "label", "role", "track_id", "body", "segment")]
        for time, speed, std in zip(curve["times"], curve["speeds"], stds, strict=True):
            if speed is not None:
                writer.writerow([*fixed, time, speed, std])
    return text.getvalue()


def _curves(gathered: Gathered) -> Iterator[dict[str, Any]]:
    for motion in (*gathered.seen, *gathered.unmatched):
        segment, track = (int(part) for part in motion.track.split(":"))
        yield _curve(
            "estimate", f"track {motion.track}", motion.times, motion.speeds, motion.stds,
            track_id=track, segment=segment, body=motion.body or None,
        )  # fmt: skip
    for true in gathered.true:
        yield _curve("truth", true.body, true.times, true.speeds, body=true.body)
    for curve in gathered.commanded:
        yield _curve("commanded", curve.label, curve.times, curve.speeds)
    for curve in gathered.encoder:
        yield _curve("encoder", curve.label, curve.times, curve.speeds)


def _curve(
    kind: str,
    label: str,
    times: Float64Array,
    *values: Float64Array,
    track_id: int | None = None,
    segment: int | None = None,
    body: str | None = None,
) -> dict[str, Any]:
    """Return a curve with its gaps; ``values`` are the speeds and, if known, their deviations."""
    times, speeds, *stds = broken(times, *values)
    return {
        "kind": kind,
        "label": label,
        "role": _OBSTACLE,
        "track_id": track_id,
        "body": body,
        "segment": segment,
        "times": np.round(times, _TIME_DIGITS).tolist(),
        "speeds": _listed(speeds),
        "stds": _listed(stds[0]) if stds else None,
    }


def _listed(values: Float64Array) -> list[float | None]:
    rounded = np.round(values, _SPEED_DIGITS).tolist()
    known = np.isfinite(values)
    return [value if here else None for value, here in zip(rounded, known, strict=True)]


def _changes(seen: Sequence[SeenMotion]) -> Iterator[dict[str, Any]]:
    """Yield the changes of the track assigned to a body, in order."""
    order: dict[str, list[tuple[float, str]]] = {}
    for each in seen:
        order.setdefault(each.body, []).extend((float(t), each.track) for t in each.frame_times)
    changes = [
        (time, body, before, after)
        for body, rows in order.items()
        for (_, before), (time, after) in pairwise(sorted(rows))
        if before != after
    ]
    for time, body, before, after in sorted(changes):
        time = round(time, _TIME_DIGITS)
        yield {"time": time, "body": body, "before": before, "after": after}
