"""Figure 17 from arrays: gaps, identities, and curves on the right clock."""

from __future__ import annotations

import dataclasses
from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from matplotlib.axes import Axes

from app.reports.gathering import Curve, Gathered, seen_motions
from app.reports.pairing import pair_with_truth
from app.reports.speed_figure import speed_figure
from observer.evaluation.gaps import broken
from observer.evaluation.speed_errors import SeenMotion, TrueMotion
from observer.figures import INK, figure_bytes, themed_svg
from observer.jsonl import ObservationLine
from observer.truth.contract import TrueBody
from observer.truth.sampled import SampledTruth, TruthSample

TIMES = np.arange(40) / 10


@pytest.fixture
def gathered() -> Gathered:
    """Two tracks with a gap between them, and a gap in the ground truth."""
    speeds = np.where((TIMES > 1.0) & (TIMES < 1.5), np.nan, 0.3)
    words = ("left",) * len(TIMES)
    first = SeenMotion("0:1", "cart", TIMES[:20], TIMES[:20], np.full(20, 0.31), np.full(20, 0.02))
    second = SeenMotion("0:2", "cart", TIMES[25:], TIMES[25:], np.full(15, 0.29), np.full(15, 0.02))
    return Gathered(
        span=(0.0, 3.9), lines=(), matched=(),
        true=(TrueMotion("cart", TIMES, speeds, words, words, np.isfinite(speeds)),),
        seen=(first, second), unmatched=(),
        commanded=(Curve("commanded", TIMES, np.full(40, 0.3)),), encoder=(),
        truth_words="", alignment=None,
    )  # fmt: skip


def _lines(axes: Axes) -> dict[str, np.ndarray]:
    return {str(line.get_label()): np.asarray(line.get_ydata()) for line in axes.lines}


def test_gaps_break_lines() -> None:
    kept = np.r_[0:10, 20:30]
    times, values = broken(TIMES[kept], np.ones(20))
    assert len(times) == 21
    assert np.flatnonzero(np.isnan(values)).tolist() == [10]
    assert times[10] == pytest.approx((TIMES[9] + TIMES[20]) / 2)
    assert len(broken(TIMES, np.ones(40))[0]) == 40


def test_new_segments_are_marked(gathered: Gathered) -> None:
    label = "new segment, with new tracks"
    bare = tuple({"segment": int(t >= 2) + int(t >= 3), "time": float(t)} for t in TIMES)
    lines = cast(tuple[ObservationLine, ...], bare)
    (axes,) = speed_figure([("", dataclasses.replace(gathered, lines=lines))]).axes
    upright = [x for line in axes.lines if len(x := np.asarray(line.get_xdata())) == 2]
    assert [x.tolist() for x in upright] == [[2.0, 2.0], [3.0, 3.0]]
    assert label in _lines(axes)
    (axes,) = speed_figure([("", dataclasses.replace(gathered, lines=lines[:20]))]).axes
    assert label not in _lines(axes)


def test_identities_are_drawn_separately_and_truth_has_its_gap(gathered: Gathered) -> None:
    (axes,) = speed_figure([("an experiment", gathered)]).axes
    drawn = _lines(axes)
    assert set(drawn) >= {"estimate", "cart, ground truth", "commanded"}
    assert len(drawn["estimate"]) == 20
    assert np.isnan(drawn["cart, ground truth"]).sum() == 4
    assert {text.get_text() for text in axes.texts} == {"0:1", "0:2"}
    # One band per track, none in between.
    bands = [np.asarray(each.get_paths()[0].vertices)[:, 0] for each in axes.collections]
    assert [(float(x.min()), float(x.max())) for x in bands] == [(0.0, 1.9), (2.5, 3.9)]


def test_unmatched_tracks_are_labelled(gathered: Gathered) -> None:
    stray = [replace(gathered.seen[1], body="")]
    labels = _lines(
        speed_figure(
            [("x", replace(gathered, seen=gathered.seen[:1], unmatched=tuple(stray)))]
        ).axes[0]
    )
    assert {"estimate", "unmatched track"} <= set(labels)


def test_a_chart_inherits_its_colours_from_the_page(gathered: Gathered) -> None:
    figure = speed_figure([("x", gathered)])
    svg = themed_svg(figure, "figure17")
    assert svg.startswith("<svg")
    assert INK not in svg
    assert "currentColor" in svg
    # No text without a colour, which would be black.
    assert not [part for part in svg.split("<text")[1:] if "fill: " not in part.split(">")[0]]
    assert figure_bytes(figure, "a", "svg") == figure_bytes(figure, "a", "svg")


def _line(number: int, id_: int, x: float, state: str = "confirmed") -> ObservationLine:
    bare = {
        "frame": number, "time": number / 10, "segment": 0,
        "pose": {"position": [0.0, 0.0, 0.0], "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]},
        "obstacles": [{
            "id": id_, "state": state, "motion": "moving", "position": [x, 0.0, 3.0],
            "speed": 0.3, "speed_std": None, "velocity_time": number / 10 - 0.05,
        }],
    }  # fmt: skip
    return cast(ObservationLine, bare)


def test_tracks_are_matched_by_position_and_coasting_ones_omitted() -> None:
    def body(id_: int, name: str, x: float) -> TrueBody:
        return TrueBody(id_, name, "obstacle", np.array([x, 0, 3.2]), np.array([0.3, 0, 0]),
                        np.array([0.4, 0.4, 0.3]), np.pi / 2, 1.0, None)  # fmt: skip

    samples = tuple(
        TruthSample(k, k / 10, (body(1, "near", 0.0), body(2, "far", 4.0))) for k in range(4)
    )
    lines = [_line(0, 7, 0.1), _line(1, 7, 0.1), _line(2, 7, 4.1), _line(3, 8, 9.0, "coasting")]
    matched = pair_with_truth(lines, SampledTruth(samples))
    seen, unmatched = seen_motions(lines, matched)
    # The track that jumped to another body is a separate stretch there.
    assert [(each.track, each.body, len(each.times)) for each in seen] == [
        ("0:7", "near", 2),
        ("0:7", "far", 1),
    ]
    assert unmatched == ()
    assert seen[0].times == pytest.approx([-0.05, 0.05])
    assert np.isnan(seen[0].stds).all()
