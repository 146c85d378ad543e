"""Chart of a run from its database rows, without its recording."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from app.contract.runs import ChartCurve, ChartValues
from app.storage import SpeedRow
from observer.evaluation.gaps import broken
from observer.geometry import Float64Array
from observer.rig.rig import OBSTACLE


def chart_of_rows(rows: Iterable[SpeedRow]) -> ChartValues:
    """Return chart values as ``app.reports.run_chart.chart_values``, without errors and switches.

    Tracks are not matched to bodies, so there are neither error figures nor identity switches.
    """
    found: defaultdict[tuple[Any, ...], list[SpeedRow]] = defaultdict(list)
    for row in rows:
        if row.role == OBSTACLE:
            segment = row.segment if row.source == "estimate" else None
            found[row.source, segment, row.track_id, row.body].append(row)
    return ChartValues(
        aligned=any(source == "truth" for source, *_ in found),
        sentence=None,
        alignment=None,
        curves=[_curve(each) for each in found.values()],
        changes=[],
        errors=[],
    )


def _curve(rows: Sequence[SpeedRow]) -> ChartCurve:
    first = rows[0]
    labels = {
        "estimate": f"track {first.segment}:{first.track_id}",
        "truth": first.body or f"body {first.track_id}",
        "commanded": "commanded",
        "encoder": "wheel encoders",
    }
    seen = first.source == "estimate"
    numbers = np.array([(row.time, row.speed, row.std) for row in rows], np.float64)
    times, speeds, stds = broken(*numbers.T)
    return ChartCurve(
        kind=first.source,
        label=labels[first.source],
        role=first.role,
        track_id=first.track_id if seen else None,
        body=first.body,
        segment=first.segment if seen else None,
        times=times.tolist(),
        speeds=_listed(speeds),
        stds=_listed(stds) if seen else None,
    )


def _listed(values: Float64Array) -> list[float | None]:
    return [None if np.isnan(value) else value for value in values.tolist()]
