"""The chart of a run that is still going, or has no recording."""

from __future__ import annotations

import pytest

from app.server.runs.row_charts import chart_of_rows
from app.storage import SpeedRow


def rows() -> list[SpeedRow]:
    made = []
    for k in range(30):
        time = k / 10
        made.append(SpeedRow("r", time, "observer", "encoder", None, 0.2, None, 0))
        if k < 10:
            made.append(SpeedRow("r", time, "obstacle", "estimate", 7, k / 10, 0.01, 0))
        elif k > 20:
            made.append(SpeedRow("r", time, "obstacle", "estimate", 7, None, None, 1))
        if not 12 <= k < 18:
            made.append(SpeedRow("r", time, "obstacle", "truth", 1, 0.5, None, k // 20, "cart"))
    return made


def test_each_track_is_a_curve_and_gaps_are_gaps() -> None:
    chart = chart_of_rows(rows())
    curves = {each.label: each for each in chart.curves}
    assert set(curves) == {"track 0:7", "track 1:7", "cart"}
    assert (chart.aligned, chart.errors, chart.changes) == (True, [], [])
    first = curves["track 0:7"]
    assert first.stds is not None
    assert list(first.speeds) == [k / 10 for k in range(10)]
    assert (first.segment, first.track_id, set(first.stds)) == (0, 7, {0.01})
    # Coasting.
    assert set(curves["track 1:7"].speeds) == {None}
    truth = curves["cart"]
    assert (truth.kind, truth.body, truth.stds) == ("truth", "cart", None)
    (hole,) = (k for k, speed in enumerate(truth.speeds) if speed is None)
    assert truth.times[hole - 1 : hole + 2] == pytest.approx([1.1, 1.45, 1.8])
    assert len(truth.times) == len(truth.speeds)


def test_a_run_without_rows_has_an_empty_chart() -> None:
    assert chart_of_rows([]).curves == []
    assert chart_of_rows([]).aligned is False
