"""``python -m tools.benchmark COMMAND``: measure the running system."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.cli.command_line import run
from app.cli.results import JsonOption, tell_measured

OutputOption = Annotated[
    Path | None, typer.Option(help="Output folder for benchmark.json and benchmark.md.")
]
SecondsOption = Annotated[float, typer.Option(min=2, help="Duration of each measurement.")]

cli = typer.Typer(
    help="Measures the cost of the running system.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


@cli.command()
def served(
    source: Annotated[str, typer.Argument(help="Source to serve.")] = "simulated:lab",
    seconds: SecondsOption = 15.0,
    viewers: Annotated[int, typer.Option(min=1, max=50, help="Number of viewers.")] = 20,
    as_json: JsonOption = False,
    output: OutputOption = None,
) -> None:
    """Measure a running server: viewers, page, latency."""
    from tools.benchmark.served import ServedFigures, served_figures
    from tools.benchmark.served_report import served_markdown

    tell_measured(
        "served",
        lambda: served_figures(source, seconds=seconds, viewer_count=viewers, say=_say),
        served_markdown,
        ServedFigures.as_dict,
        output,
        as_json=as_json,
    )


@cli.command()
def capture(as_json: JsonOption = False, output: OutputOption = None) -> None:
    """Measure what live capture adds to the loop: about a minute."""
    from tools.benchmark.capture_report import capture_markdown
    from tools.benchmark.live_capture import CaptureFigures, capture_figures

    tell_measured(
        "capture",
        lambda: capture_figures(say=_say),
        capture_markdown,
        CaptureFigures.as_dict,
        output,
        as_json=as_json,
    )


@cli.command()
def starved(
    share: Annotated[float, typer.Option(min=0.05, max=1.0, help="Part of one core.")] = 0.25,
    seconds: SecondsOption = 30.0,
    as_json: JsonOption = False,
    output: OutputOption = None,
) -> None:
    """Measure how old the displayed data gets on a small share of one core; needs root."""
    from tools.benchmark.starved import StarvedFigures, starved_figures
    from tools.benchmark.starved_report import starved_markdown

    tell_measured(
        "starved",
        lambda: starved_figures(share, seconds, say=_say),
        starved_markdown,
        StarvedFigures.as_dict,
        output,
        as_json=as_json,
    )


@cli.command()
def recording(
    seconds: SecondsOption = 15.0, as_json: JsonOption = False, output: OutputOption = None
) -> None:
    """Measure what recording 640x480 pairs costs the loop, at each pace and in each mode."""
    from tools.benchmark.recording_cost import RecordingFigures, recording_figures
    from tools.benchmark.recording_report import recording_markdown

    tell_measured(
        "recording",
        lambda: recording_figures(seconds=seconds, say=_say),
        recording_markdown,
        RecordingFigures.as_dict,
        output,
        as_json=as_json,
    )


@cli.command()
def soak(
    minutes: Annotated[float, typer.Option(min=0.1, help="Duration.")] = 60.0,
    run_seconds: Annotated[float, typer.Option(min=1, help="Duration of each run.")] = 10.0,
    as_json: JsonOption = False,
    output: OutputOption = None,
) -> None:
    """Keep a server busy and see whether its processes grow; exit code 1 if they do."""
    from tools.benchmark.soak import SoakFigures, soak_figures
    from tools.benchmark.soak_report import soak_markdown

    measured: list[SoakFigures] = []

    def measure() -> SoakFigures:
        measured.append(soak_figures(minutes=minutes, run_s=run_seconds, say=_say_line))
        return measured[0]

    tell_measured("soak", measure, soak_markdown, SoakFigures.as_dict, output, as_json=as_json)
    if measured[0].failed:
        raise typer.Exit(1)


def _say_line(line: str) -> None:
    typer.echo(line, err=True)


def _say(what: str) -> None:
    typer.echo(f"measuring {what}", err=True)


if __name__ == "__main__":
    run(cli)
