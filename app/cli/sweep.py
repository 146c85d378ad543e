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
    from observer.evaluation.sweep.results import Sweep


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
        int | None, typer.Option(min=5, help="Maximum number of frames per source; default: all.")
    ] = None,
    runs: Annotated[
        int | None,
        typer.Option(
            min=1, help=f"Runs through each crowd, each with its own seed; default: {DEFAULT_RUNS}."
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
            help="Metric to rank by (mean over the sources); mota, and time_ratio for crowds."
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
        typer.Option(min=1, max=1024, help="Number of processes; default: one per core."),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="tcp://HOST:PORT", help="Use this dask cluster instead."),
    ] = None,
    cache_mb: Annotated[
        int, typer.Option(min=0, help="Memory per process for cached frames, MB.")
    ] = 600,
) -> None:
    """Evaluate every combination of parameters on every source, and rank them.

    Sources need ground truth. Crowds are driven through by the planner, as in navigate-benchmark,
    and the grid then varies parameters of guard and navigation. Finished tasks are saved at once,
    so that an interrupted sweep continues when it is called again.
    """
    # Importing them loads OpenCV and the methods, which takes seconds.
    from observer.evaluation.sweep.cluster import ClusterChoice, cluster_missing
    from observer.evaluation.sweep.crowds import sweep_crowd
    from observer.evaluation.sweep.grid import read_grid
    from observer.evaluation.sweep.results import rankable
    from observer.evaluation.sweep.sources import sweep_source
    from observer.evaluation.sweep.store import TaskStore
    from observer.evaluation.sweep.sweep import Plan, SweepRun

    missing = cluster_missing()
    if missing is not None:
        raise InputError(missing)
    if scheduler is not None and jobs is not None:
        raise InputError("--jobs is for processes on this computer; omit it with --scheduler")
    crowds = [spec for spec in sources if spec.startswith(CROWD)]
    driving = bool(crowds)
    if driving and len(crowds) < len(sources):
        raise InputError(
            "crowds and sources have different metrics; sweep over only one of the two"
        )
    if (idle := frames if driving else runs) is not None:
        name = "--frames" if driving else "--runs"
        raise InputError(f"{name} {idle} has no effect on these sources; omit it")
    if driving and road:
        raise InputError("--road has no effect on crowds; omit it")
    by = rankable(rank_by, driving=driving)
    read = read_grid(grid, driving=driving)
    combinations = read.chosen(limit=limit, drawn=drawn, seed=seed)
    store = TaskStore(output)
    plan = Plan(
        read,
        combinations,
        tuple(sweep_crowd(spec, runs or DEFAULT_RUNS) for spec in crowds)
        or tuple(sweep_source(spec, frames) for spec in sources),
        (ROAD if road else LAB).gate_m,
    )
    run = SweepRun(plan, store)
    of_all = "" if len(combinations) == read.count else f" of {read.count}"
    typer.echo(
        f"{len(combinations)}{of_all} combinations over {len(plan.sources)} sources: "
        f"{plan.count} tasks, {run.kept} of them already finished",
        err=True,
    )
    cluster = ClusterChoice(scheduler, jobs or os.cpu_count() or 1)
    try:
        with progress_bar("sweeping") as progress:
            run.run(cluster, cache_bytes=cache_mb * 1_000_000, progress=progress)
    except KeyboardInterrupt:
        typer.echo(
            f"interrupted with {run.result.left} of {plan.count} tasks left; finished tasks are "
            "kept; run the same command again to continue",
            err=True,
        )
        raise
    finally:
        # Done for an interrupted sweep too: its finished results are worth seeing.
        result = run.result
        text = _write(result, output, by)
    typer.echo(text.rstrip())
    if run.use is not None:
        typer.echo(
            f"{run.use.tasks} tasks in {run.use.elapsed_s:.1f} s; the {cluster.workers} processes "
            f"were busy {run.use.at_work:.0%} of the time and had a core {run.use.computing:.0%}",
            err=True,
        )
    if result.failed:
        first = result.failed[0]
        assert first.outcome is not None
        raise TasksFailed(
            f"{len(result.failed)} of {plan.count} tasks failed, first combination "
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
