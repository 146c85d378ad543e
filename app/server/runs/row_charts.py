"""Chart of a run from its database rows, without its recording."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from statistics import median
from typing import Any

from app.contract.runs import ChartCurve, ChartValues
from app.storage import SpeedRow

_OBSTACLE = "obstacle"
# Same as in ``app.reports.gaps``, which the server does not import.
_GAP_STEPS = 3.0
_FEWEST_STEPS = 2


def chart_of_rows(rows: Iterable[SpeedRow]) -> ChartValues:
    """Return chart values as ``app.reports.run_chart.chart_values``, without errors and switches.

    Tracks are not matched to bodies, so there are neither error figures nor identity switches.
    """
    found: defaultdict[tuple[Any, ...], list[SpeedRow]] = defaultdict(list)
    for row in rows:
        if row.role == _OBSTACLE:
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
    times, speeds, stds = zip(*_broken(rows), strict=True)
    return ChartCurve(
        kind=first.source,
        label=labels[first.source],
        role=first.role,
        track_id=first.track_id if seen else None,
        body=first.body,
        segment=first.segment if seen else None,
        times=times,
        speeds=speeds,
        stds=stds if seen else None,
    )


def _broken(
    rows: Sequence[SpeedRow],
) -> Iterator[tuple[float, float | None, float | None]]:
    """Yield time, speed and standard deviation of each row, with None values in every gap.

    So no line is drawn across a gap.
    """
    steps = [after.time - before.time for before, after in pairwise(rows)]
    longest = _GAP_STEPS * median(steps) if len(steps) >= _FEWEST_STEPS else math.inf
    for before, row in zip((rows[0], *rows), rows, strict=False):
        if row.time - before.time > longest:
            yield (before.time + row.time) / 2, None, None
        yield row.time, row.speed, row.std
