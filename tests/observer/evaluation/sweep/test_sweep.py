"""A sweep over a folder and a recording, on a cluster in this process."""

from __future__ import annotations

import importlib.util
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from observer.errors import InputError
from observer.evaluation.evaluate import summarise
from observer.evaluation.source_run import run_source
from observer.evaluation.sources import described
from observer.evaluation.sweep import cluster, frames
from observer.evaluation.sweep.cluster import ClusterChoice, opened_cluster
from observer.evaluation.sweep.frames import FrameCache
from observer.evaluation.sweep.grid import grid_from_text
from observer.evaluation.sweep.sources import sweep_source
from observer.evaluation.sweep.store import TaskStore
from observer.evaluation.sweep.sweep import CoreUse, Plan, SweepRun
from observer.evaluation.sweep.task import Outcome, Task, method_version, run_task
from observer.opening import open_source
from observer.parameters import preset
from observer.types import StereoFrame

HERE = ClusterChoice(processes=False)
# Any request to it fails.
NOWHERE = ClusterChoice("tcp://127.0.0.1:9")
GRID = "evidence.radius_px: [26, 60]"
GATE_M = 0.5


def plan_of(specs: tuple[str, ...], text: str = GRID) -> Plan:
    grid = grid_from_text(text, "grid.yaml")
    sources = tuple(sweep_source(spec, None) for spec in specs)
    return Plan(grid, grid.chosen(), sources, GATE_M)


def test_sweep_matches_the_benchmark_and_resumes_where_interrupted(
    sources: tuple[str, str], tmp_path: Path
) -> None:
    steps: list[tuple[int, int]] = []
    store = TaskStore(tmp_path)

    def end_after_three(done: int, total: int) -> None:
        steps.append((done, total))
        if done == 3:
            raise KeyboardInterrupt

    ended = SweepRun(plan_of(sources), store)
    with pytest.raises(KeyboardInterrupt):
        ended.run(HERE, progress=end_after_three)
    assert steps == [(0, 4), (1, 4), (2, 4), (3, 4)]
    assert ended.result.left == 1
    again = SweepRun(plan_of(sources), store)
    assert again.kept == 3
    again.run(HERE)
    whole = SweepRun(plan_of(sources), store)
    assert whole.kept == 4
    whole.run(NOWHERE)

    result = whole.result
    assert result.failed == ()
    assert result.left == 0
    default = preset("default")
    presets = {str(r): default.changed({"evidence.radius_px": r}) for r in (26.0, 60.0)}
    for spec in sources:
        alone = run_source(described(spec), presets, 100, GATE_M, lambda _: None)
        for row in (each for each in result.rows if each.source.name == spec):
            expected = alone[str(row.combination.values["evidence.radius_px"])]
            assert expected.tally is not None
            assert row.figures == summarise([expected.tally]).as_dict()
            assert row.outcome is not None
            assert row.outcome.frames == expected.frames
            assert row.source.extent == f"{expected.frames} frames"
            assert row.outcome.cost_ratio is not None
            if row.combination.parameters == default:
                # Compared with itself on the same frames, but the machine is shared.
                assert 0.5 < row.outcome.cost_ratio < 2
    assert any((row.figures["matched"] or 0) > 0 for row in result.rows)


def test_failed_task_is_reported_and_retried(
    sources: tuple[str, str], copied: Callable[..., str], tmp_path: Path
) -> None:
    # Written again, so that no cache confuses it with the other folder.
    folder = Path(copied("gone"))
    plan = plan_of((str(folder), sources[1]), "evidence.radius_px: [26]")
    shutil.move(folder, tmp_path / "elsewhere")
    store = TaskStore(tmp_path)
    run = SweepRun(plan, store)
    run.run(HERE)
    (failed,) = run.result.failed
    assert failed.outcome is not None
    assert failed.source.name == str(folder)
    assert failed.outcome.error is not None
    assert "gone" in failed.outcome.error
    assert run.result.left == 0
    shutil.move(tmp_path / "elsewhere", folder)
    again = SweepRun(plan, store)
    assert again.kept == 1
    again.run(HERE)
    assert again.result.failed == ()


def test_bug_in_a_task_does_not_kill_the_worker(sources: tuple[str, str]) -> None:
    source = sweep_source(sources[0], 5)
    broken = Task(source, "no parameters", GATE_M, method_version())  # type: ignore[arg-type]
    outcome = run_task(broken, 10**9, False)
    assert outcome.error is not None
    assert outcome.error.startswith("AttributeError: ")
    other = Task(source, preset("default"), GATE_M, "another", elsewhere=True)
    assert "install the same version" in (run_task(other, 10**9, False).error or "")


def test_task_key_covers_everything_the_result_depends_on(sources: tuple[str, str]) -> None:
    one, two = sweep_source(sources[0], None), sweep_source(sources[1], None)
    default = preset("default")
    tasks = [
        Task(one, default, 0.5, "1"),
        Task(two, default, 0.5, "1"),
        Task(sweep_source(sources[0], 10), default, 0.5, "1"),
        Task(one, default.changed({"evidence.radius_px": 27}), 0.5, "1"),
        Task(one, default, 3.0, "1"),
        Task(one, default, 0.5, "2"),
    ]
    assert len({task.key for task in tasks}) == len(tasks)
    assert Task(sweep_source(sources[0], None), default, 0.5, "1").key == tasks[0].key


def test_damaged_stored_result_is_ignored(sources: tuple[str, str], tmp_path: Path) -> None:
    store = TaskStore(tmp_path)
    task = Task(sweep_source(sources[0], 5), preset("default"), GATE_M, method_version())
    outcome = run_task(task, 10**9, False)
    store.keep(task, outcome)
    assert store.find(task) == outcome
    (path,) = (tmp_path / "tasks").iterdir()
    path.write_text(path.read_text()[:100])
    assert store.find(task) is None


def test_source_is_read_once_unless_too_large_for_the_cache(
    sources: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    real = open_source

    def counted(spec: str) -> object:
        opened.append(spec)
        return real(spec)

    monkeypatch.setattr(frames, "open_source", counted)
    one, two = (sweep_source(spec, 6) for spec in sources)

    def times(cache: FrameCache, source: object) -> list[float]:
        assert source in (one, two)
        with_truth = cache.opened(one if source is one else two)
        found: list[float] = []
        while isinstance(frame := with_truth.source.read(), StereoFrame) and len(found) < 6:
            found.append(frame.time)
        with_truth.source.close()
        assert with_truth.truth is not None
        return found

    roomy = FrameCache(10**9)
    first = times(roomy, one)
    assert len(first) == 6
    assert times(roomy, one) == first
    assert times(roomy, two) == times(roomy, two)
    assert len(opened) == 2
    opened.clear()
    size = 6 * 2 * 512 * 256 * 3
    # There is room for only one source, so each evicts the other.
    narrow = FrameCache(size)
    for _ in range(2):
        assert times(narrow, one) == first
        times(narrow, two)
    assert len(opened) == 4
    opened.clear()
    none = FrameCache(0)
    assert times(none, one) == times(none, one) == first
    # Opened once to find out that it does not fit, then again each time.
    assert len(opened) == 3


def test_results_of_a_scenario_are_kept_by_its_content_and_seed(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"

    def key(suffix: str = "") -> str:
        source = sweep_source(f"simulated:{path}{suffix}", None)
        return Task(source, preset("default"), GATE_M, "1").key

    path.write_text("based_on: lateral\ntexture: {robot: red}\n")
    first = key()
    assert key("?seed=1") != first
    path.write_text("based_on: lateral\ntexture: {robot: dark}\n")
    assert key() != first
    path.write_text("# The same scenario.\nbased_on: lateral\ntexture: {robot: red}\n")
    assert key() == key("?seed=0") == first


@pytest.mark.parametrize(
    ("spec", "part"),
    [
        ("camera:0,1", "live"),
        ("coppeliasim:localhost:23000", "live"),
        ("simulated:nowhere", "nowhere"),
        ("simulated:lab?seed=one", "seed=NUMBER"),
        ("/no/such/run.mcap", "run.mcap"),
    ],
)
def test_unsweepable_source_is_refused(spec: str, part: str) -> None:
    with pytest.raises(InputError, match=part):
        sweep_source(spec, None)


def test_source_without_truth_or_calibration_is_refused(
    copied: Callable[..., str], sources: tuple[str, str], tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="has no ground truth"):
        sweep_source(copied("bare", without="truth.csv"), None)
    with pytest.raises(InputError, match="has no calibration"):
        sweep_source(copied("raw", without="calibration.yaml"), None)
    with pytest.raises(InputError, match="given twice"):
        SweepRun(plan_of((sources[1], sources[1])), TaskStore(tmp_path))


def test_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    real = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda n: None if n == "distributed" else real(n)
    )
    with (
        pytest.raises(
            InputError, match=r"needs the package distributed, .*'dynamic-observer\[cluster\]'"
        ),
        opened_cluster(HERE),
    ):
        pass


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "lab-server"])
def test_unreachable_scheduler_is_reported(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "_JOINING_S", 0.3)
    with (
        pytest.raises(InputError, match="no scheduler answers at"),
        opened_cluster(ClusterChoice(address)),
    ):
        pass


def test_sweep_runs_on_an_existing_cluster(sources: tuple[str, str], tmp_path: Path) -> None:
    from distributed import LocalCluster

    free = "127.0.0.1:0"
    with LocalCluster(  # type: ignore[no-untyped-call]
        n_workers=1,
        threads_per_worker=1,
        processes=False,
        protocol="tcp://",
        host="127.0.0.1",
        dashboard_address=free,
        worker_dashboard_address=free,
    ) as lab:
        run = SweepRun(plan_of(sources[1:], "evidence.radius_px: [26]"), TaskStore(tmp_path))
        run.run(ClusterChoice(lab.scheduler_address, processes=False))
    (row,) = run.result.rows
    assert row.outcome is not None
    assert row.outcome.error is None
    assert row.source.extent == f"{row.outcome.frames} frames"


def test_core_use_covers_all_processes() -> None:
    outcomes = [Outcome(cpu_s=2.0, wall_s=3.0), Outcome(cpu_s=4.0, wall_s=5.0), Outcome("broken")]
    assert CoreUse.of(outcomes, 5.0, 2) == CoreUse(3, 5.0, 0.8, 0.6)
