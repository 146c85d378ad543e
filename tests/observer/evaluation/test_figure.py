"""The figure of a benchmark: its content, and that it is written in every format."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from observer.errors import InputError
from observer.evaluation.benchmark import run_benchmark
from observer.evaluation.breakdown import break_down
from observer.evaluation.choices import LAB
from observer.evaluation.counts import FalseInstance, Sample, Tally
from observer.evaluation.evaluate import summarise
from observer.evaluation.figure import benchmark_figure, save_figure
from observer.evaluation.results import (
    Benchmark,
    OpenCvCost,
    PresetResult,
    SourceResult,
    Timing,
)
from observer.evaluation.sources import BenchmarkSource

FALSE = FalseInstance(1, 0, 0.1, 5, (0.0, 0.0, 2.0), 0.3, 2.0, None, None, None)


def result(*, timed: bool = True, truth: bool = True) -> Benchmark:
    sample = Sample(2.5, 0.3, 0.1, matched=True, velocity_error_mps=0.04)
    presets, sources = [], []
    for name, false in (("paper", 30), ("default", 0)):
        tally = Tally(frames=60, samples=[sample], false=[FALSE] * false, moved=True)
        presets.append(
            PresetResult(
                preset=name,
                timings={"stereo": Timing(2.0, 3.0), "total": Timing(6.0, 9.0)} if timed else {},
                opencv=OpenCvCost(Timing(4.0, 5.0), 1.5, 1.4, {"remap": 4.0}) if timed else None,
                evaluation=summarise([tally]) if truth else None,
                breakdown=break_down([tally], LAB) if truth else None,
            )
        )
        declared: list[tuple[str, Literal["ideal", "faulty"]]] = [
            ("simulated:skew?seed=1", "faulty"),
            ("simulated:away?seed=1", "ideal"),
            ("simulated:away?seed=2", "ideal"),
        ]
        for spec, declares in declared:
            source = BenchmarkSource(spec, declares, "everything", 60)
            evaluation = summarise([tally]) if truth else None
            sources.append(SourceResult(name, source, 60, 0, evaluation, tuple(tally.false)))
    return Benchmark(LAB, 1, tuple(presets), tuple(sources))


def titles(figure: Figure) -> list[str]:
    figure.draw_without_rendering()
    return [axes.get_title(loc="left") for axes in figure.get_axes()]


ACCURACY = [
    f"{what} by {by}"
    for what in ("Recall", "Velocity error")
    for by in ("range", "true speed", "direction")
]


def test_only_measured_quantities_have_a_panel() -> None:
    assert titles(benchmark_figure(result())) == [
        *ACCURACY,
        "False instances by source",
        "Cost by stage",
    ]
    assert titles(benchmark_figure(result(timed=False))) == [
        *ACCURACY,
        "False instances by source",
    ]
    assert titles(benchmark_figure(result(truth=False))) == ["Cost by stage"]
    assert titles(benchmark_figure(result(truth=False, timed=False))) == []


def test_plotted_points_match_the_figures() -> None:
    figure = benchmark_figure(result())
    axes = dict(zip(titles(figure), figure.get_axes(), strict=True))
    velocity = axes["Velocity error by range"].get_lines()[1]
    np.testing.assert_array_equal(velocity.get_ydata(), [np.nan, 0.04, np.nan, np.nan])
    false = axes["False instances by source"]
    labels = [label.get_text() for label in false.get_yticklabels()]
    # Seeds are summed; ideal scenarios come first.
    assert labels == ["away", "skew (faulty)"]
    assert list(np.asarray(false.get_lines()[0].get_xdata())) == [50.0, 50.0]
    assert list(np.asarray(false.get_lines()[1].get_xdata())) == [0.0, 0.0]
    cost = axes["Cost by stage"]
    assert [label.get_text() for label in cost.get_yticklabels()] == [
        "stereo",
        "whole step",
        "OpenCV calls only",
    ]
    bars = [bar for bar in cost.patches if isinstance(bar, Rectangle)]
    assert sorted(bar.get_width() for bar in bars) == [2, 2, 4, 4, 6, 6]
    assert "paper 1.5" in cost.get_title(loc="right")


def test_figure_of_a_real_benchmark_with_one_preset() -> None:
    from observer.parameters import preset

    done = run_benchmark(["simulated:lateral"], {"default": preset("default")}, max_frames=8)
    assert "Cost by stage" in titles(benchmark_figure(done))


@pytest.mark.parametrize(
    ("name", "begins"), [("a.png", b"\x89PNG"), ("a.svg", b"<?xml"), ("a.PDF", b"%PDF")]
)
def test_every_format_is_written_without_leftover_files(
    tmp_path: Path, name: str, begins: bytes
) -> None:
    path = tmp_path / name
    save_figure(benchmark_figure(result()), path)
    assert path.read_bytes().startswith(begins)
    assert [each.name for each in tmp_path.iterdir()] == [name]
    if name == "a.png":
        image = cv2.imread(str(path))
        assert image is not None
        assert image.shape[1] > 1500
        assert image[5, 5].tolist() == [255, 255, 255]


def test_missing_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot write"):
        save_figure(Figure(), tmp_path / "none" / "a.png")
