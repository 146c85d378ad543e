"""Results of a measurement, on stdout and as ``benchmark.json`` and ``benchmark.md``."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from app.cli.output import whole_text
from observer.errors import InputError

JsonOption = Annotated[bool, typer.Option("--json", help="Print the results as JSON on stdout.")]

# Those of ``observer.figures``, whose import takes too long for the start of every command.
FIGURE_SUFFIXES = (".png", ".svg", ".pdf")

_Figures = TypeVar("_Figures")


def make_folder(output: Path | None) -> None:
    """Make the folder of results; call it before hours of work, so that it fails early.

    Raises:
        InputError: it cannot be made.
    """
    if output is None:
        return
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make the folder {output}: {error.strerror}") from None


def check_figure_path(path: Path) -> None:
    """Reject the path of a figure before hours of work, not after.

    Raises:
        InputError: no figure can be written there.
    """
    if path.suffix.lower() not in FIGURE_SUFFIXES:
        raise InputError(
            f"the figure's file name must end in {', '.join(FIGURE_SUFFIXES)}, not {path.name}"
        )
    if not path.parent.is_dir():
        raise InputError(f"cannot write {path}: the folder {path.parent} does not exist")


def tell(text: str, values: dict[str, Any], output: Path | None, *, as_json: bool) -> None:
    """Print results and save them.

    Args:
        text: Markdown. values: the same results for JSON.
        output: an existing folder; None saves nothing.
        as_json: whether to print JSON instead of the text.
    """
    data = json.dumps(values, indent=2, allow_nan=False)
    if output is not None:
        for name, content in (("benchmark.json", data), ("benchmark.md", text)):
            with whole_text(output / name) as file:
                file.write(content + "\n")
    typer.echo(data if as_json else text)


def tell_measured(
    name: str,
    measure: Callable[[], _Figures],
    markdown: Callable[[_Figures], str],
    as_dict: Callable[[_Figures], Any],
    output: Path | None,
    *,
    as_json: bool,
) -> None:
    """Measure one thing and report it with the machine and its load before and after.

    Args:
        name: key of the figures in JSON.

    Raises:
        InputError: the folder of results cannot be made.
    """
    # This import loads OpenCV, which reads the environment when it is imported.
    from observer.evaluation.machine import load, machine_facts, machine_line

    make_folder(output)
    before = load()
    figures = measure()
    after = load()
    known = None if before is None or after is None else (before, after)
    lines = [machine_line(), ""]
    if known is not None:
        lines.append(f"Load: {known[0]:.1f} before, {known[1]:.1f} after.\n")
    lines.append(markdown(figures))
    values = {"machine": machine_facts(), "load": known, name: as_dict(figures)}
    tell("\n".join(lines).rstrip(), values, output, as_json=as_json)
