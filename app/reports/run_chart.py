"""Chart of one run as plain values, for drawing on a page and for tables."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator

import numpy as np

from app.contract.runs import (
    ChartCurve,
    ChartValues,
    IdentityChange,
    SpeedErrorsEntry,
    SpeedSource,
)
from app.contract.values import filled
from app.reports.comparison import alignment_facts
from app.reports.gathering import Gathered
from observer.evaluation.gaps import broken
from observer.evaluation.speed_errors import identity_switches, speed_errors
from observer.geometry import Float64Array
from observer.rig.rig import OBSTACLE

# Tenths of a millisecond and of a millimetre per second are finer than a chart shows.
_TIME_DIGITS, _SPEED_DIGITS = 4, 5
CSV_COLUMNS = ("source", "label", "role", "track_id", "body", "segment", "time_s", "speed_mps",
               "std_mps")  # fmt: skip


def chart_values(gathered: Gathered) -> ChartValues:
    """Return the answer of ``GET /api/runs/{id}/chart`` except the run itself.

    A speed of None marks a gap. Times are on the run's clock, seconds.
    """
    alignment = gathered.alignment
    errors = speed_errors(gathered.seen, gathered.true) if gathered.true else ()
    return ChartValues(
        aligned=bool(gathered.true),
        sentence=gathered.truth_words,
        alignment=None if alignment is None else alignment_facts(alignment),
        curves=list(_curves(gathered)),
        changes=[
            IdentityChange(round(time, _TIME_DIGITS), body, before, after)
            for time, body, before, after in sorted(identity_switches(gathered.seen))
        ],
        errors=[filled(SpeedErrorsEntry, each) for each in errors],
    )


def chart_csv(values: ChartValues) -> str:
    """Return one row for each speed of ``chart_values``; gaps are left out, unknowns are empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    for curve in values.curves:
        stds = curve.stds or [None] * len(curve.times)
        fixed = (curve.kind, curve.label, curve.role, curve.track_id, curve.body, curve.segment)
        for time, speed, std in zip(curve.times, curve.speeds, stds, strict=True):
            if speed is not None:
                writer.writerow([*fixed, time, speed, std])
    return text.getvalue()


def _curves(gathered: Gathered) -> Iterator[ChartCurve]:
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
    kind: SpeedSource,
    label: str,
    times: Float64Array,
    *values: Float64Array,
    track_id: int | None = None,
    segment: int | None = None,
    body: str | None = None,
) -> ChartCurve:
    """Return a curve with its gaps; ``values``: speeds and, if known, their standard deviations."""
    times, speeds, *stds = broken(times, *values)
    return ChartCurve(
        kind=kind,
        label=label,
        role=OBSTACLE,
        track_id=track_id,
        body=body,
        segment=segment,
        times=np.round(times, _TIME_DIGITS).tolist(),
        speeds=_listed(speeds),
        stds=_listed(stds[0]) if stds else None,
    )


def _listed(values: Float64Array) -> list[float | None]:
    rounded = np.round(values, _SPEED_DIGITS).tolist()
    known = np.isfinite(values)
    return [value if here else None for value, here in zip(rounded, known, strict=True)]
