"""``dynamic-observer parameters``: list every tuning parameter, its range and its effect."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from observer.guard.parameters import AllParameters
from observer.parameters import MODELS


def parameters(
    as_markdown: Annotated[bool, typer.Option("--markdown", help="As a Markdown table.")] = False,
) -> None:
    """List the parameters that --set, the panel and REST take."""
    if as_markdown:
        typer.echo(parameter_table())
        return
    for entry in AllParameters.declared():
        typer.echo(f"{entry['name']} = {_shown(entry['default'])}   ({_range(entry)})")
        typer.echo(f"    {entry['help']} Acts with {_models(entry)}.")


def parameter_table() -> str:
    """Return all parameters as one Markdown table, built from their only declaration."""
    rows = [
        "| parameter | default | range | acts with | what it does |",
        "| --- | --- | --- | --- | --- |",
    ]
    rows += [
        f"| `{e['name']}` | {_shown(e['default'])} | {_range(e)} | {_models(e)} | {e['help']} |"
        for e in AllParameters.declared()
    ]
    return "\n".join(rows)


def _shown(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value}"


def _models(entry: dict[str, Any]) -> str:
    models = "all" if entry["models"] == list(MODELS) else ", ".join(entry["models"])
    return f"{models}; on the cloud with all" if entry.get("cloud") else models


def _range(entry: dict[str, Any]) -> str:
    if entry["type"] == "choice":
        return ", ".join(entry["choices"])
    if entry["type"] == "boolean":
        return "true, false"
    return f"{entry['minimum']:g} to {entry['maximum']:g} {entry['unit']}".strip()
