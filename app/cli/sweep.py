"""``dynamic-observer sweep``: run a grid of parameters over many sources or through crowds, on all
cores or a cluster.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.output import whole_text
from app.cli.progress import progress_bar
from observer.errors import DynamicObserverError, InputError
from observer.evaluation.choices import CROWD, DEFAULT_RUNS, LAB, ROAD, RankedBy

if TYPE_CHECKING:
    from observer.evaluation.sweep.crowds import SweepCrowd
    from observer.evaluation.sweep.results import Sweep
    from observer.evaluation.sweep.sources import SweepSource
    from observer.evaluation.sweep.sweep import CoreUse, Plan


class TasksFailed(DynamicObserverError):
    """Failure of some tasks of a sweep; the results of the others are written."""


def sweep(
    grid: Annotated[
        Path,
        typer.Argument(
            help="YAML that names parameters with lists of values; preset: a list of presets, "
            "set: values of every combination."
        ),
    ],
    sources: Annotated[
        list[str],
        typer.Argument(
            help="Recordings, folders with truth.csv, simulated:SCENARIO; or, to drive through, "
            "crowd:hard:DENSITY and crowd:kind:DENSITY."
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(help="Folder for results and finished tasks, where a sweep continues."),
    ],
    frames: Annotated[
        int | None, typer.Option(min=5, help="Maximum number of frames per source. [default: all]")
    ] = None,
    runs: Annotated[
        int | None,
        typer.Option(
            min=1,
            help=f"Runs through each crowd, each with its own seed. [default: {DEFAULT_RUNS}]",
        ),
    ] = None,
    limit: Annotated[
        int | None, typer.Option(min=1, help="Only the first combinations, up to this many.")
    ] = None,
    drawn: Annotated[
        int | None,
        typer.Option("--random", min=1, help="Only this many combinations, chosen at random."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the random choice.")] = 0,
    rank_by: Annotated[
        RankedBy | None,
        typer.Option(
            help="Metric to rank by (mean over the sources). [default: mota, or time_ratio "
            "for crowds]"
        ),
    ] = None,
    road: Annotated[
        bool,
        typer.Option(
            "--road",
            help=f"Match ground truth within {ROAD.gate_m:g} m instead of {LAB.gate_m:g} m.",
        ),
    ] = False,
    jobs: Annotated[
        int | None,
        typer.Option(min=1, max=1024, help="Number of processes. [default: one per core]"),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="tcp://HOST:PORT", help="Use this dask cluster instead."),
    ] = None,
    cache_mb: Annotated[
        int, typer.Option(min=0, help="Memory per process for cached frames, MB.")
    ] = 600,
) -> None:
    """Evaluate and rank combinations of parameters.

    Every combination is evaluated on every source. Sources need ground truth. Crowds are
    driven through by the planner, as in navigate-benchmark, and the grid then varies
    parameters of guard and navigation. Finished tasks are saved at once, so that an
    interrupted sweep continues when it is called again.
    """
    # Importing them loads OpenCV and the methods, which takes seconds.
    from observer.evaluation.sweep.cluster import ClusterChoice
    from observer.evaluation.sweep.grid import read_grid
    from observer.evaluation.sweep.results import rankable
    from observer.evaluation.sweep.store import TaskStore
    from observer.evaluation.sweep.sweep import Plan, SweepRun

    _check_processes(scheduler, jobs)
    driving = _are_crowds(sources)
    _check_effects(driving, frames=frames, runs=runs, road=road)
    by = rankable(rank_by, driving=driving)
    read = read_grid(grid, driving=driving)
    combinations = read.chosen(limit=limit, drawn=drawn, seed=seed)
    store = TaskStore(output)
    opened = _opened_crowds(sources, runs) if driving else _opened_sources(sources, frames)
    plan = Plan(read, combinations, opened, (ROAD if road else LAB).gate_m)
    run = SweepRun(plan, store)
    _tell_plan(plan, run.kept)
    cluster = ClusterChoice(scheduler, jobs or os.cpu_count() or 1)
    try:
        with progress_bar("sweeping") as progress:
            run.run(cluster, cache_bytes=cache_mb * 1_000_000, progress=progress)
    except KeyboardInterrupt:
        _tell_interrupt(run.result.left, plan.count)
        raise
    finally:
        # Done for an interrupted sweep too: its finished results are worth seeing.
        result = run.result
        text = _write(result, output, by)
    typer.echo(text.rstrip())
    if run.use is not None:
        _tell_use(run.use, cluster.workers)
    _check_outcomes(result, plan.count)


def _check_processes(scheduler: str | None, jobs: int | None) -> None:
    """Refuse processes that cannot be started."""
    from observer.evaluation.sweep.cluster import cluster_missing

    missing = cluster_missing()
    if missing is not None:
        raise InputError(missing)
    if scheduler is not None and jobs is not None:
        raise InputError("--jobs is for processes on this computer; omit it with --scheduler")


def _are_crowds(specs: list[str]) -> bool:
    """Return whether the sources are crowds to drive through; refuse a mixture."""
    crowds = [spec.startswith(CROWD) for spec in specs]
    if any(crowds) and not all(crowds):
        raise InputError(
            "crowds and sources have different metrics; sweep over only one of the two"
        )
    return any(crowds)


def _check_effects(driving: bool, *, frames: int | None, runs: int | None, road: bool) -> None:
    """Refuse options that have no effect on sources of this kind."""
    name, given = ("--frames", frames) if driving else ("--runs", runs)
    if given is not None:
        raise InputError(f"{name} {given} has no effect on these sources; omit it")
    if driving and road:
        raise InputError("--road has no effect on crowds; omit it")


def _opened_crowds(specs: list[str], runs: int | None) -> tuple[SweepCrowd, ...]:
    from observer.evaluation.sweep.crowds import sweep_crowd

    return tuple(sweep_crowd(spec, runs or DEFAULT_RUNS) for spec in specs)


def _opened_sources(specs: list[str], frames: int | None) -> tuple[SweepSource, ...]:
    from observer.evaluation.sweep.sources import sweep_source

    return tuple(sweep_source(spec, frames) for spec in specs)


def _tell_plan(plan: Plan, kept: int) -> None:
    count = len(plan.combinations)
    of_all = "" if count == plan.grid.count else f" of {plan.grid.count}"
    typer.echo(
        f"{count}{of_all} combinations over {len(plan.sources)} sources: "
        f"{plan.count} tasks, {kept} of them already finished",
        err=True,
    )


def _tell_interrupt(left: int, count: int) -> None:
    typer.echo(
        f"interrupted with {left} of {count} tasks left; finished tasks are kept; run the same "
        "command again to continue",
        err=True,
    )


def _tell_use(use: CoreUse, workers: int) -> None:
    typer.echo(
        f"{use.tasks} tasks in {use.elapsed_s:.1f} s; each of the {workers} processes was busy for "
        f"{use.at_work:.0%} of the time and used {use.computing:.0%} of a core",
        err=True,
    )


def _check_outcomes(result: Sweep, count: int) -> None:
    """Raise ``TasksFailed`` if any task failed."""
    if not result.failed:
        return
    first = result.failed[0]
    assert first.outcome is not None
    raise TasksFailed(
        f"{len(result.failed)} of {count} tasks failed, first combination "
        f"{first.combination.number} over {first.source.name}: {first.outcome.error}"
    )


def _write(result: Sweep, folder: Path, rank_by: RankedBy) -> str:
    # Imported here because matplotlib would slow down the start of every command.
    from observer.evaluation.figure import save_figure
    from observer.evaluation.sweep.figure import sweep_figure
    from observer.evaluation.sweep.results import ranking
    from observer.evaluation.sweep.tables import ranking_csv, ranking_markdown, write_parquet

    ranked = ranking(result, rank_by)
    text = ranking_markdown(result, ranked, rank_by)
    write_parquet(result, folder / "results.parquet")
    for name, content in (("ranking.md", text), ("ranking.csv", ranking_csv(result, ranked))):
        with whole_text(folder / name) as file:
            file.write(content)
    save_figure(sweep_figure(result, ranked, rank_by), folder / "sweep.png")
    return text
