"""``dynamic-observer navigate-benchmark``: measure driving to a goal among people."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from app.cli.assignments import changes_of
from app.cli.progress import progress_bar
from app.cli.results import JsonOption, check_figure_path, tell
from observer.evaluation.navigation.parameters import crowd_parameters

# Lower seeds were used while the planner was developed.
_FIRST_SEED = 1000
_DENSITIES = (0.1, 0.2)
_RISK = "navigation.risk_per_metre"


def navigate_benchmark(
    runs: Annotated[
        int,
        typer.Option(min=1, max=10_000, help="Runs of each combination, each with its own seed."),
    ] = 20,
    density: Annotated[
        list[float] | None,
        typer.Option(
            min=0.0,
            max=1.0,
            metavar="NUMBER",
            help="People per m²; give it several times to compare. [default: 0.1 and 0.2]",
        ),
    ] = None,
    kind: Annotated[
        bool | None,
        typer.Option(
            "--kind/--hard",
            help="Only people who avoid the robot, or only people who ignore it. [default: both]",
        ),
    ] = None,
    risk: Annotated[
        list[float] | None,
        typer.Option(
            metavar="NUMBER",
            help="Accepted probability of a contact per metre; give it several times to "
            f"compare. [default: {_RISK}]",
        ),
    ] = None,
    assignments: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="Value of a parameter of guard or navigation; repeatable.",
        ),
    ] = None,
    image_runs: Annotated[
        int,
        typer.Option(
            min=0,
            max=10_000,
            help="Also drive this many runs of the planner with rendered images, among people who "
            "ignore the robot; each takes about a minute.",
        ),
    ] = 0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first run.")] = _FIRST_SEED,
    jobs: Annotated[
        int | None,
        typer.Option(min=1, max=1024, help="Number of processes. [default: one per core]"),
    ] = None,
    as_json: JsonOption = False,
    figure: Annotated[
        Path | None,
        typer.Option(help="Plot contacts over declared risk to this .png, .svg or .pdf file."),
    ] = None,
) -> None:
    """Measure driving to a goal among people.

    The planner is compared with the guard alone. The robot drives 10 m through a room of 14 by
    10 m. A third-party crowd model, JuPedSim, moves the people. The robot perceives them with
    the measured errors of the observer, and in --image-runs by the observer itself, from
    rendered images.
    """
    if figure is not None:
        check_figure_path(figure)
    parameters = crowd_parameters(changes_of(assignments or []))
    for each in risk or []:
        parameters.changed({_RISK: each})
    # Importing them loads OpenCV and the methods, which takes seconds.
    from observer.evaluation.navigation.benchmark import Choice, measure
    from observer.evaluation.navigation.tables import navigation_markdown

    choice = Choice(
        runs=runs,
        densities=_each_once(density, _DENSITIES),
        kinds=(False, True) if kind is None else (kind,),
        risks=_each_once(risk, (parameters.navigation.risk_per_metre,)),
        seed=seed,
        image_runs=image_runs,
        parameters=parameters,
    )
    with progress_bar("driving") as progress:
        result = measure(choice, jobs or os.cpu_count() or 1, progress)
    if figure is not None:
        # Imported here because matplotlib would slow down the start of every command.
        from observer.evaluation.figure import save_figure
        from observer.evaluation.navigation.figure import navigation_figure

        save_figure(navigation_figure(result), figure)
    tell(navigation_markdown(result).rstrip(), result.as_dict(), None, as_json=as_json)


def _each_once(given: list[float] | None, default: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(dict.fromkeys(given)) if given else default
