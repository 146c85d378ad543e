"""``dynamic-observer benchmark``: what the method and the server cost, and how good presets are."""

from __future__ import annotations

import json
import os
import platform
import random
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import cv2
import typer

from app.cli.output import whole_file
from app.cli.progress import progress_bar
from observer.errors import InputError
from observer.evaluation.benchmark import DEFAULT_MAX_FRAMES, Progress, run_benchmark
from observer.evaluation.breakdown import LAB, ROAD
from observer.evaluation.evaluate import markdown_table
from observer.evaluation.report import benchmark_markdown
from observer.evaluation.results import Benchmark
from observer.evaluation.sources import simulated_sources
from observer.parameters import preset, preset_names
from observer.simulation.scenarios import load_scenario, scenario_names
from tools.benchmark.browser import PageFigures
from tools.benchmark.parts import measured_parts
from tools.benchmark.served import (
    DenseCloudRates,
    DriveLateness,
    ServedFigures,
    served_figures,
)

FIGURE_SUFFIXES = (".png", ".svg", ".pdf")
_SERVED_SOURCE = "simulated:lab"


def benchmark(
    source: Annotated[
        str | None,
        typer.Argument(help="A source of your own; all benchmark scenarios if left out."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Figures as JSON on stdout.")] = False,
    seeds: Annotated[
        int, typer.Option(min=1, max=100, help="Seeds of each scenario, drawn at run time.")
    ] = 1,
    seed: Annotated[
        list[int] | None, typer.Option(help="A certain seed in place of drawn ones.")
    ] = None,
    frames: Annotated[
        int, typer.Option(min=5, help="Most frames of each source.")
    ] = DEFAULT_MAX_FRAMES,
    road: Annotated[
        bool,
        typer.Option(
            "--road",
            help=f"Match truth within {ROAD.gate_m:g} m instead of {LAB.gate_m:g} m, and classes "
            f"of range and speed for roads.",
        ),
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option(help="A folder for benchmark.json, benchmark.md and benchmark.png."),
    ] = None,
    figure: Annotated[
        Path | None, typer.Option(help="Draw the comparison into this .png, .svg or .pdf.")
    ] = None,
    jobs: Annotated[
        int,
        typer.Option(
            min=1,
            max=64,
            help="Spread the sources over so many processes: the same accuracy sooner, but the "
            "cost of observe is then not measured.",
        ),
    ] = 1,
    served: Annotated[
        bool, typer.Option(help="Measure a running server, too: viewers, page, latency.")
    ] = True,
    seconds: Annotated[
        float, typer.Option(min=2, help="Length of each measurement on the server.")
    ] = 15.0,
    viewers: Annotated[int, typer.Option(min=1, max=50, help="Viewers on the server.")] = 5,
    calibration: Annotated[
        bool,
        typer.Option(
            "--calibration",
            help="Calibrate simulated cameras with a board, once for each seed, in place of all "
            "else: about 10 s each.",
        ),
    ] = False,
    capture: Annotated[
        bool,
        typer.Option(
            "--capture",
            help="Measure what live capture adds to the loop, in place of all else: about a "
            "minute.",
        ),
    ] = False,
    recording: Annotated[
        bool,
        typer.Option(
            "--recording",
            help="Measure what recording 640x480 pairs takes from the loop, in place of all "
            "else; --seconds is the time of each pace and mode.",
        ),
    ] = False,
) -> None:
    """Compare the presets over scenarios and seeds, and time the loop and the server.

    Calibration, live capture and recording are measured only where they are asked for, and then
    alone.
    """
    drawn = seed or random.SystemRandom().sample(range(1, 10_000), seeds)
    if calibration or capture or recording:
        if source is not None or figure is not None:
            raise InputError(
                "--calibration, --capture and --recording bring their own source and draw no "
                "figure; leave SOURCE and --figure out"
            )
        _make_folder(output)
        parts = measured_parts(
            drawn if calibration else (),
            capture=capture,
            recording_s=seconds if recording else None,
        )
        machine: dict[str, Any] = {"machine": _machine()}
        as_text = f"{_machine_line()}\n\n{parts.markdown()}".rstrip()
        as_data = json.dumps(machine | parts.as_dict(), indent=2, allow_nan=False)
        _write_results(output, as_data, as_text)
        typer.echo(as_data if as_json else as_text)
        return
    figures_to = _figure_paths(figure, output)
    sources = [source] if source else list(simulated_sources(_benchmark_scenarios(), drawn))
    with progress_bar("observing") as progress:

        def report(at: Progress) -> None:
            progress(at.done, at.total)

        method = run_benchmark(
            sources,
            {name: preset(name) for name in preset_names()},
            max_frames=frames,
            scale=ROAD if road else LAB,
            jobs=jobs,
            progress=report,
        )
    figures: ServedFigures | None = None
    if served:
        figures = served_figures(
            source or _SERVED_SOURCE,
            seconds=seconds,
            viewer_count=viewers,
            say=lambda what: typer.echo(f"measuring {what}", err=True),
        )
    shown_seeds = None if source else drawn
    as_text = _markdown(method, figures, shown_seeds)
    as_data = json.dumps(_as_dict(method, figures, shown_seeds), indent=2, allow_nan=False)
    _write_results(output, as_data, as_text)
    if figures_to:
        # Imported where it is needed: matplotlib would slow down the start of every command.
        from observer.evaluation.figure import benchmark_figure, save_figure

        for path in figures_to:
            save_figure(benchmark_figure(method), path)
    typer.echo(as_data if as_json else as_text)


def _figure_paths(figure: Path | None, output: Path | None) -> list[Path]:
    """Where to draw; refused before hours of work rather than after them."""
    paths = [] if figure is None else [figure]
    _make_folder(output)
    if output is not None:
        paths.append(output / "benchmark.png")
    for path in paths:
        if path.suffix.lower() not in FIGURE_SUFFIXES:
            raise InputError(
                f"a figure's name must end in {', '.join(FIGURE_SUFFIXES)}, unlike {path.name}"
            )
        if not path.parent.is_dir():
            raise InputError(f"cannot write {path}: the folder {path.parent} does not exist")
    return paths


def _make_folder(output: Path | None) -> None:
    if output is None:
        return
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make the folder {output}: {error.strerror}") from None


def _write_results(output: Path | None, as_data: str, as_text: str) -> None:
    if output is None:
        return
    for name, text in (("benchmark.json", as_data), ("benchmark.md", as_text)):
        with whole_file(output / name) as file:
            file.write(text + "\n")


def _benchmark_scenarios() -> list[str]:
    return [name for name in scenario_names() if load_scenario(name).benchmark]


def _machine() -> dict[str, Any]:
    return {
        "platform": platform.platform(),
        "python": platform.python_version(),
        "opencv": cv2.__version__,
        "cores": os.cpu_count(),
    }


def _machine_line() -> str:
    return f"Machine: {', '.join(f'{key} {value}' for key, value in _machine().items())}."


def _as_dict(
    method: Benchmark, served: ServedFigures | None, seeds: list[int] | None
) -> dict[str, Any]:
    result: dict[str, Any] = {"machine": _machine(), "seeds": seeds} | method.as_dict()
    if served is not None:
        result["served"] = {
            "loop": [asdict(r) | {"ratio": r.ratio} for r in served.rates],
            "dense_cloud": asdict(served.dense_cloud) | {"ratio": served.dense_cloud.ratio},
            "page": asdict(served.page) if isinstance(served.page, PageFigures) else served.page,
        }
    return result


def _markdown(method: Benchmark, served: ServedFigures | None, seeds: list[int] | None) -> str:
    parts = [_machine_line()]
    if seeds:
        parts.append(f"Seeds: {', '.join(map(str, seeds))}.")
    parts += ["", benchmark_markdown(method)]
    if served is not None:
        parts += [
            "\n## The loop in a running server, unique frames per second\n",
            markdown_table(
                ["played at", "alone", "with viewers", "ratio", "viewers", "scene messages",
                 "observations", "images", "failures"],
                [
                    [
                        f"{r.playback_rate:g} x", f"{r.alone:.1f}", f"{r.with_viewers:.1f}",
                        f"{r.ratio:.2f}", str(r.viewers), str(r.scene_messages),
                        str(r.observation_messages), str(r.image_messages), str(len(r.failures)),
                    ]
                    for r in served.rates
                ],
            ),
            f"\n{_drive_line(served)}",
            "\n## The dense cloud beside the loop\n",
            _dense_cloud_table(served.dense_cloud),
            "\n## One visible page\n",
            served.page if isinstance(served.page, str) else _page_table(served.page),
        ]  # fmt: skip
    return "\n".join(parts).rstrip()


def _drive_line(served: ServedFigures) -> str:
    told = "; ".join(
        f"at {r.playback_rate:g} x {_late(r.drive)}, with a run recorded besides "
        f"{_late(r.recorded)}"
        for r in served.rates
    )
    return f"The drive loop's lateness with viewers, over its last 30 s: {told}."


def _late(drive: DriveLateness | None) -> str:
    return "there was no drive process" if drive is None else drive.words


def _dense_cloud_table(rates: DenseCloudRates) -> str:
    def shown(value: float | None, factor: float = 1.0) -> str:
        return "never" if value is None else f"{factor * value:.0f} ms"

    return markdown_table(
        ["played at", "loop without", "loop with", "ratio", "clouds per s", "age", "cost of one",
         "pixels along one matched", "failures"],
        [
            [
                f"{rates.playback_rate:g} x", f"{rates.without:.1f}", f"{rates.watched:.1f}",
                f"{rates.ratio:.2f}", f"{rates.clouds_per_s:.1f}", shown(rates.age_s, 1e3),
                shown(rates.median_ms), str(rates.coarseness), str(len(rates.failures)),
            ]
        ],
    )  # fmt: skip


def _page_table(page: PageFigures) -> str:
    def shown(value: float | None, unit: str) -> str:
        return "never" if value is None else f"{value:.1f} {unit}"

    return markdown_table(
        ["figure", "value"],
        [
            ["first obstacle after the server's start", shown(page.first_obstacle_s, "s")],
            ["received to painted, median", shown(page.latency_median_ms, "ms")],
            ["received to painted, p95", shown(page.latency_p95_ms, "ms")],
            ["observations acknowledged", str(page.count)],
        ],
    )
