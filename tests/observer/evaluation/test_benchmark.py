"""The benchmark on a few frames of the simulated lab: complete, ordered, repeatable."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from observer.errors import InputError, ScenarioError
from observer.evaluation.benchmark import run_benchmark
from observer.evaluation.report import benchmark_markdown
from observer.evaluation.results import Benchmark
from observer.evaluation.source_run import run_source
from observer.evaluation.sources import described, simulated_sources
from observer.parameters import preset
from observer.simulation.export import export_stereo_folder

PRESETS = {"paper": preset("paper"), "default": preset("default")}
FRAMES = 12


def noting(steps: list[tuple[int, int]]) -> Callable[[int, int], None]:
    return lambda done, total: steps.append((done, total))


@pytest.fixture(scope="module")
def lab() -> tuple[Benchmark, list[tuple[int, int]]]:
    steps: list[tuple[int, int]] = []
    sources = simulated_sources(["lab"], [0, 5])
    return run_benchmark(sources, PRESETS, max_frames=FRAMES, progress=noting(steps)), steps


def test_every_preset_runs_on_every_source(lab: tuple[Benchmark, list[tuple[int, int]]]) -> None:
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


def test_timings_name_every_stage_and_add_up(lab: tuple[Benchmark, list[tuple[int, int]]]) -> None:
    stages = {
        "paper": {"features", "matching", "stereo", "ego_motion", "residual_flow", "tracking"},
        "default": {"klt_tracking", "ego_motion", "motion", "tracking", "features"},
    }
    assert {each.preset for each in lab[0].presets} == set(stages)
    for each in lab[0].presets:
        assert stages[each.preset] <= set(each.timings)
        for timing in each.timings.values():
            assert 0 <= timing.median_ms <= timing.p95_ms
        parts = sum(t.median_ms for stage, t in each.timings.items() if stage != "total")
        assert parts <= 1.5 * each.timings["total"].p95_ms


def test_progress_increases_to_the_end(lab: tuple[Benchmark, list[tuple[int, int]]]) -> None:
    _, steps = lab
    assert steps == sorted(steps)
    assert steps[-1] == (2 * FRAMES, 2 * FRAMES)


def test_result_is_written_as_json_and_markdown(
    lab: tuple[Benchmark, list[tuple[int, int]]],
) -> None:
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


def test_opencv_share_of_the_cost_is_reported(lab: tuple[Benchmark, list[tuple[int, int]]]) -> None:
    result, _ = lab
    for each in result.presets:
        cost = each.opencv
        assert cost is not None
        assert "calcOpticalFlowPyrLK" in cost.calls_ms
        assert list(cost.calls_ms.values()) == sorted(cost.calls_ms.values(), reverse=True)
        assert cost.ratio == pytest.approx(each.timings["total"].median_ms / cost.timing.median_ms)
        assert cost.ratio_within > 1
        figures = {t.figure for t in each.targets}
        assert {"observe ms, median", "observe relative to OpenCV alone"} <= figures
    assert "whole step / OpenCV" in benchmark_markdown(result)


def test_opencv_is_timed_on_separate_frames() -> None:
    seen = run_source(described("simulated:lab"), PRESETS, 18, 0.5, lambda _: None)
    for run in seen.values():
        clean, recorded = len(run.times_ms["total"]), len(run.opencv_ms)
        assert clean + recorded == 18 - 3
        assert 2 <= recorded <= 8
        for whole, calls in zip(run.recorded_ms, run.opencv_ms, strict=True):
            assert 0 < sum(calls.values()) < whole


@pytest.mark.patient
def test_several_processes_give_the_same_accuracy_without_cost(
    lab: tuple[Benchmark, list[tuple[int, int]]],
) -> None:
    alone, sources = lab[0], simulated_sources(["lab"], [0, 5])
    steps: list[tuple[int, int]] = []
    spread = run_benchmark(sources, PRESETS, max_frames=FRAMES, jobs=2, progress=noting(steps))
    assert spread.sources == alone.sources
    for one, other in zip(alone.presets, spread.presets, strict=True):
        assert (one.evaluation, one.breakdown) == (other.evaluation, other.breakdown)
        assert other.timings == {}
        assert other.opencv is None
        accuracy = [t for t in one.targets if not t.figure.startswith("observe ")]
        assert list(other.targets) == accuracy
    assert steps == sorted(steps)
    assert steps[-1] == (2 * FRAMES, 2 * FRAMES)
    assert "Not measured: 2 processes" in benchmark_markdown(spread)


def test_error_in_a_worker_process_is_reraised(tmp_path: Path) -> None:
    scenario, folder = tmp_path / "short.yaml", tmp_path / "short"
    scenario.write_text("based_on: lab\nduration_s: 0.2\n")
    export_stereo_folder(str(scenario), 0, folder)
    (folder / "calibration.yaml").unlink()
    with pytest.raises(InputError, match="has no calibration"):
        run_benchmark([str(folder)] * 2, PRESETS, max_frames=3, jobs=2)


def test_detection_only_sources_give_no_errors() -> None:
    (spec,) = simulated_sources(["miscalibrated_vergence"], [0])
    source = described(spec)
    assert (source.declares, source.scored_for, source.frames) == ("faulty", "detection", 150)
    presets = {"default": PRESETS["default"]}
    result = run_benchmark([spec], presets, max_frames=30)
    for found in (result.sources[0].evaluation, result.presets[0].evaluation):
        assert found is not None
        assert found.matched > 0
        assert found.coverage is not None
        assert (found.speed_rmse_mps, found.velocity_rmse_mps) == (None, None)
        assert (found.centre_rmse_m, found.surface_rmse_m, found.motp_m) == (None, None, None)
    whole = run_benchmark(simulated_sources(["lateral"], [0]), presets, max_frames=30)
    assert whole.presets[0].evaluation is not None
    assert whole.presets[0].evaluation.speed_rmse_mps is not None


def test_scenarios_with_people_are_listed_separately() -> None:
    specs = simulated_sources(["people_stop_and_go", "lateral"], [1])
    (result,) = run_benchmark(specs, {"default": PRESETS["default"]}, max_frames=30).presets
    assert result.breakdown is not None
    assert [g.label for g in result.breakdown.by_kind] == ["ideal", "ideal, people"]
    assert [g.label for g in result.breakdown.by_body] == ["robots", "people"]
    assert [g.count for g in result.breakdown.by_kind] == [
        g.count for g in result.breakdown.by_body
    ]
    assert result.evaluation is not None
    assert 0 < (result.evaluation.box_iou_median or 0) < 1
    people = [t for t in result.targets if "people, 0.4 m/s" in t.figure]
    assert len(people) == 4
    assert people[0].count > 0


def test_progress_total_matches_the_scenario_length() -> None:
    steps: list[tuple[int, int]] = []
    run_benchmark(["simulated:lab"], {"paper": PRESETS["paper"]}, max_frames=6,
                  progress=noting(steps))  # fmt: skip
    # One step per frame, with none left out.
    assert steps == [(done, 6) for done in range(7)]
    assert described("simulated:toward?seed=4").planned(300) == 135
    assert described("simulated:toward?seed=4").planned(20) == 20


def test_accuracy_is_reproducible(lab: tuple[Benchmark, list[tuple[int, int]]]) -> None:
    sources = simulated_sources(["lab"], [5])
    again = run_benchmark(sources, {"default": PRESETS["default"]}, max_frames=FRAMES)
    (first,) = [s for s in lab[0].sources if (s.preset, s.source.spec) == ("default", sources[0])]
    assert again.sources[0].evaluation == first.evaluation


def test_empty_benchmarks_and_unknown_scenarios_are_refused() -> None:
    with pytest.raises(InputError, match="at least one source"):
        run_benchmark([], PRESETS)
    with pytest.raises(InputError, match="one preset"):
        run_benchmark(["simulated:lab"], {})
    with pytest.raises(ScenarioError):
        run_benchmark(["simulated:nowhere"], PRESETS)
