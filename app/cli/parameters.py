"""``dynamic-observer parameters``: list every tuning parameter, its range and its effect."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from observer.navigation.parameters import AllParameters
from observer.parameters import MODELS, preset, preset_names

Entry = dict[str, Any]


def parameters(
    as_markdown: Annotated[
        bool, typer.Option("--markdown", help="Print a Markdown table.")
    ] = False,
    basic: Annotated[
        bool,
        typer.Option("--basic", help="List only the eight most important ones of each method."),
    ] = False,
) -> None:
    """List the parameters.

    Those that --set, the web page and REST accept.
    """
    entries = basic_parameters() if basic else AllParameters.declared()
    if as_markdown:
        typer.echo(parameter_table(entries))
        return
    for entry in entries:
        typer.echo(f"{entry['name']} = {_shown(entry['default'])}   ({_range(entry)})")
        typer.echo(f"    {entry['help']} Used by {_models(entry)}.")


def basic_parameters() -> list[Entry]:
    """Return the declarations of the parameters that are shown first, in order."""
    return [entry for entry in AllParameters.declared() if entry.get("basic")]


def parameter_table(entries: list[Entry]) -> str:
    """Return parameters as one Markdown table, built from their only declaration."""
    rows = [
        "| parameter | default | range | used by | what it does |",
        "| --- | --- | --- | --- | --- |",
    ]
    rows += [
        f"| `{e['name']}` | {_shown(e['default'])} | {_range(e)} | {_models(e)} | {e['help']} |"
        for e in entries
    ]
    return "\n".join(rows)


def preset_table() -> str:
    """Return the values in which the built-in presets differ as one Markdown table."""
    values = {name: preset(name).flat() for name in preset_names()}
    rows = [f"| parameter | {' | '.join(f'`{name}`' for name in values)} |"]
    rows.append(f"| --- |{' --- |' * len(values)}")
    for entry in AllParameters.declared():
        of_each = [_shown(flat.get(entry["name"], entry["default"])) for flat in values.values()]
        if len(set(of_each)) > 1:
            rows.append(f"| `{entry['name']}` | {' | '.join(of_each)} |")
    return "\n".join(rows)


def _shown(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value}"


def _models(entry: Entry) -> str:
    models = "all" if entry["models"] == list(MODELS) else ", ".join(entry["models"])
    return f"{models}; all for the point cloud" if entry.get("cloud") else models


def _range(entry: Entry) -> str:
    if entry["type"] == "choice":
        return ", ".join(entry["choices"])
    if entry["type"] == "boolean":
        return "true, false"
    return f"{entry['minimum']:g} to {entry['maximum']:g} {entry['unit']}".strip()
