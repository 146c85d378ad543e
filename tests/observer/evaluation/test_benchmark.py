"""The benchmark on a few frames of the simulated lab: complete, ordered, repeatable."""

from __future__ import annotations

import json

import pytest

from observer.errors import InputError, ScenarioError
from observer.evaluation.benchmark import Progress, run_benchmark
from observer.evaluation.report import benchmark_markdown
from observer.evaluation.results import Benchmark
from observer.evaluation.sources import simulated_sources
from observer.parameters import preset

PRESETS = {"paper": preset("paper"), "default": preset("default")}
FRAMES = 12


@pytest.fixture(scope="module")
def lab() -> tuple[Benchmark, list[Progress]]:
    steps: list[Progress] = []
    sources = simulated_sources(["lab"], [0, 5])
    return run_benchmark(sources, PRESETS, max_frames=FRAMES, progress=steps.append), steps


def test_every_preset_meets_every_source(lab: tuple[Benchmark, list[Progress]]) -> None:
    result, _ = lab
    assert [(s.preset, s.source.spec) for s in result.sources] == [
        ("paper", "simulated:lab?seed=0"),
        ("paper", "simulated:lab?seed=5"),
        ("default", "simulated:lab?seed=0"),
        ("default", "simulated:lab?seed=5"),
    ]
    for source in result.sources:
        assert source.frames == FRAMES
        assert source.skipped == 0
        assert source.evaluation is not None
    for each in result.presets:
        assert each.evaluation is not None
        assert each.evaluation.frames == 2 * FRAMES


def test_timings_name_every_stage_and_add_up(lab: tuple[Benchmark, list[Progress]]) -> None:
    for each in lab[0].presets:
        assert {"features", "matching", "stereo", "ego_motion", "tracking"} <= set(each.timings)
        for timing in each.timings.values():
            assert 0 <= timing.median_ms <= timing.p95_ms
        parts = sum(t.median_ms for stage, t in each.timings.items() if stage != "total")
        assert parts <= 1.5 * each.timings["total"].p95_ms


def test_progress_rises_to_its_end(lab: tuple[Benchmark, list[Progress]]) -> None:
    _, steps = lab
    assert [s.done for s in steps] == sorted(s.done for s in steps)
    assert steps[-1].done == steps[-1].total == 2 * FRAMES
    assert {s.what for s in steps} == set(simulated_sources(["lab"], [0, 5]))


def test_the_result_as_json_and_markdown(lab: tuple[Benchmark, list[Progress]]) -> None:
    result, _ = lab
    again = json.loads(json.dumps(result.as_dict(), allow_nan=False))
    assert set(again) == {"scale", "jobs", "presets", "sources"}
    assert again["presets"][0]["timings_ms"]["total"]["median"] > 0
    text = benchmark_markdown(result)
    for words in (
        "| figure | paper | default |",
        "| recall |",
        "| **whole step** |",
        "simulated:lab?seed=5",
    ):
        assert words in text


def test_accuracy_is_the_same_each_time(lab: tuple[Benchmark, list[Progress]]) -> None:
    sources = simulated_sources(["lab"], [5])
    again = run_benchmark(sources, {"default": PRESETS["default"]}, max_frames=FRAMES)
    (first,) = [s for s in lab[0].sources if (s.preset, s.source.spec) == ("default", sources[0])]
    assert again.sources[0].evaluation == first.evaluation


def test_nothing_to_do_and_unknown_scenarios_are_refused() -> None:
    with pytest.raises(InputError, match="at least one source"):
        run_benchmark([], PRESETS)
    with pytest.raises(InputError, match="one preset"):
        run_benchmark(["simulated:lab"], {})
    with pytest.raises(ScenarioError):
        run_benchmark(["simulated:nowhere"], PRESETS)
