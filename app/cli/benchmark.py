"""``dynamic-observer benchmark``: measure the accuracy of presets and the cost of the method."""

from __future__ import annotations

import random
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from app.cli.progress import progress_bar
from app.cli.results import JsonOption, check_figure_path, make_folder, tell, tell_measured
from observer.errors import InputError
from observer.evaluation.choices import DEFAULT_MAX_FRAMES, LAB, ROAD

if TYPE_CHECKING:
    from observer.evaluation.calibration_accuracy import CalibrationAccuracy
    from observer.evaluation.results import Benchmark


def benchmark(
    source: Annotated[
        str | None,
        typer.Argument(help="A source of your own. [default: all benchmark scenarios]"),
    ] = None,
    as_json: JsonOption = False,
    seeds: Annotated[
        int, typer.Option(min=1, max=100, help="Seeds of each scenario, drawn at run time.")
    ] = 1,
    seed: Annotated[
        list[int] | None,
        typer.Option(metavar="NUMBER", help="Use this seed instead of random ones; repeatable."),
    ] = None,
    frames: Annotated[
        int, typer.Option(min=5, help="Maximum number of frames per source.")
    ] = DEFAULT_MAX_FRAMES,
    road: Annotated[
        bool,
        typer.Option(
            "--road",
            help=f"For roads: match ground truth within {ROAD.gate_m:g} m instead of "
            f"{LAB.gate_m:g} m, with matching range and speed classes.",
        ),
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option(help="Output folder for benchmark.json, benchmark.md and benchmark.png."),
    ] = None,
    figure: Annotated[
        Path | None, typer.Option(help="Plot the comparison to this .png, .svg or .pdf file.")
    ] = None,
    jobs: Annotated[
        int,
        typer.Option(
            min=1,
            max=64,
            help="Number of parallel processes: the same accuracy sooner, but the processing time "
            "is then not measured.",
        ),
    ] = 1,
    calibration: Annotated[
        bool,
        typer.Option(
            "--calibration",
            help="Only calibrate simulated cameras with a board, once per seed: about 10 s each.",
        ),
    ] = False,
) -> None:
    """Compare the presets over scenarios and seeds.

    Also measures the processing time. Calibration is measured only with --calibration, and
    then nothing else is.
    """
    drawn = seed or random.SystemRandom().sample(range(1, 10_000), seeds)
    if calibration:
        if source is not None or figure is not None:
            raise InputError(
                "--calibration uses its own cameras and draws no figure; omit SOURCE and --figure"
            )
        _benchmark_calibration(drawn, output, as_json=as_json)
        return
    figures_to = _figure_paths(figure, output)
    # Importing it loads OpenCV and the methods, which takes seconds.
    from observer.evaluation.benchmark import run_benchmark
    from observer.parameters import preset, preset_names

    with progress_bar("observing") as progress:
        result = run_benchmark(
            [source] if source else _scenario_sources(drawn),
            {name: preset(name) for name in preset_names()},
            max_frames=frames,
            scale=ROAD if road else LAB,
            jobs=jobs,
            progress=progress,
        )
    _tell_benchmark(result, None if source else drawn, output, as_json=as_json)
    _save_figures(result, figures_to)


def _scenario_sources(seeds: list[int]) -> list[str]:
    """Return every benchmark scenario with every seed."""
    from observer.evaluation.sources import simulated_sources
    from observer.simulation.scenarios import load_scenario, scenario_names

    scenarios = [name for name in scenario_names() if load_scenario(name).benchmark]
    return list(simulated_sources(scenarios, seeds))


def _tell_benchmark(
    result: Benchmark, seeds: list[int] | None, output: Path | None, *, as_json: bool
) -> None:
    """Print and save a result with the machine; ``seeds`` is None for a source without any."""
    from observer.evaluation.machine import machine_facts, machine_line
    from observer.evaluation.report import benchmark_markdown

    lines = [machine_line()]
    if seeds:
        lines.append(f"Seeds: {', '.join(map(str, seeds))}.")
    lines += ["", benchmark_markdown(result)]
    values = {"machine": machine_facts(), "seeds": seeds} | result.as_dict()
    tell("\n".join(lines).rstrip(), values, output, as_json=as_json)


def _figure_paths(figure: Path | None, output: Path | None) -> list[Path]:
    """Return the paths of the figures; reject bad ones before hours of work, not after."""
    paths = [] if figure is None else [figure]
    make_folder(output)
    if output is not None:
        paths.append(output / "benchmark.png")
    for path in paths:
        check_figure_path(path)
    return paths


def _save_figures(result: Benchmark, paths: list[Path]) -> None:
    if paths:
        # Imported here because matplotlib would slow down the start of every command.
        from observer.evaluation.figure import benchmark_figure, save_figure

        for path in paths:
            save_figure(benchmark_figure(result), path)


def _benchmark_calibration(seeds: list[int], output: Path | None, *, as_json: bool) -> None:
    """Calibrate simulated cameras, once per seed; print and save the result."""
    from observer.evaluation.calibration_report import calibration_markdown

    tell_measured(
        "calibration",
        lambda: _calibrations(seeds),
        calibration_markdown,
        _calibrations_as_dict,
        output,
        as_json=as_json,
    )


def _calibrations(seeds: list[int]) -> tuple[CalibrationAccuracy, ...]:
    from observer.evaluation.calibration_accuracy import calibration_accuracy

    runs = []
    with progress_bar("calibrating") as progress:
        for done, seed in enumerate(seeds):
            progress(done, len(seeds))
            runs.append(calibration_accuracy(seed))
    return tuple(runs)


def _calibrations_as_dict(runs: tuple[CalibrationAccuracy, ...]) -> dict[str, Any]:
    from observer.evaluation.calibration_accuracy import calibration_targets

    targets = calibration_targets(runs)
    return {
        "seeds": [asdict(run) for run in runs],
        "targets": {name: [each.as_dict() for each in some] for name, some in targets.items()},
    }
