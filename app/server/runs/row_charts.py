"""Chart of a run from its database rows, without its recording."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from statistics import median
from typing import Any

from app.storage import SpeedRow

_OBSTACLE = "obstacle"
# Same as in ``app.reports.gaps``, which the server does not import.
_GAP_STEPS = 3.0
_FEWEST_STEPS = 2


def chart_of_rows(rows: Iterable[SpeedRow]) -> dict[str, Any]:
    """Return the values of ``app.reports.run_chart.chart_values``, without matching tracks to
    bodies.

    So they have neither errors nor identity switches.
    """
    curves: dict[tuple[Any, ...], dict[str, Any]] = {}
    for row in rows:
        if row.role != _OBSTACLE:
            continue
        seen = row.source == "estimate"
        segment = row.segment if seen else None
        key = (row.source, segment, row.track_id, row.body)
        curve = curves.setdefault(key, _curve(row, segment))
        curve["times"].append(row.time)
        curve["speeds"].append(row.speed)
        if seen:
            curve["stds"].append(row.std)
    for curve in curves.values():
        _break(curve)
    return {
        "aligned": any(source == "truth" for source, *_ in curves),
        "sentence": None,
        "alignment": None,
        "curves": list(curves.values()),
        "changes": [],
        "errors": [],
    }


def _break(curve: dict[str, Any]) -> None:
    """Insert None into every gap, so that no line is drawn across it."""
    times = curve["times"]
    steps = [after - before for before, after in pairwise(times)]
    if len(steps) < _FEWEST_STEPS:
        return
    longest = _GAP_STEPS * median(steps)
    # From the end, so that earlier indices stay valid.
    for k in range(len(steps), 0, -1):
        if steps[k - 1] > longest:
            times.insert(k, (times[k - 1] + times[k]) / 2)
            curve["speeds"].insert(k, None)
            if curve["stds"] is not None:
                curve["stds"].insert(k, None)


def _curve(row: SpeedRow, segment: int | None) -> dict[str, Any]:
    labels = {
        "estimate": f"track {row.segment}:{row.track_id}",
        "truth": row.body or f"body {row.track_id}",
        "commanded": "as commanded",
        "encoder": "by its encoders",
    }
    return {
        "kind": row.source,
        "label": labels[row.source],
        "role": row.role,
        "track_id": row.track_id if segment is not None else None,
        "body": row.body,
        "segment": segment,
        "times": [],
        "speeds": [],
        "stds": None if segment is None else [],
    }
