"""Pages of the documentation that are generated from the code's declarations during its build.

mkdocs calls ``on_files`` (``hooks`` in ``docs/mkdocs.yml``). None of these pages is committed, so
none can disagree with what the code declares.
"""

from __future__ import annotations

import html
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from app.cli.command_line import COMMANDS, load_command
from app.cli.parameters import basic_parameters, parameter_table, preset_table
from app.contract.glossary import GLOSSARY
from observer.navigation.parameters import AllParameters
from tools import ROOT

_PROGRAM = "dynamic-observer"


def command_page() -> str:
    """Return every command of the command line with all it takes, as in its ``--help``."""
    parts = [
        "# Commands",
        "In a clone the command is `.venv/bin/dynamic-observer`. Data goes to standard output or "
        "to the named file, progress and errors go to standard error. The exit code is 0 for "
        "success, 1 for failed work, and 2 for wrong usage or input.",
        _table(
            ("command", "what it does"),
            ((f"[`{name}`](#{name})", _cell(line)) for name, line in COMMANDS.items()),
        ),
    ]
    for name in COMMANDS:
        command = load_command(name)
        context = command.make_context(f"{_PROGRAM} {name}", [], resilient_parsing=True)
        parts += [f"## {name}", _paragraphs(command.help or "")]
        usage = " ".join(command.collect_usage_pieces(context))
        parts.append(f"```text\n{_PROGRAM} {name} {usage}\n```")
        records = (each.get_help_record(context) for each in command.get_params(context))
        # A default and a range in brackets, one after the other, would be a link.
        rows = [
            (_code(taken), _cell(said).replace("[", r"\[")) for taken, said in filter(None, records)
        ]
        parts.append(_table(("takes", "meaning"), rows))
    return _page(parts)


def parameter_page() -> str:
    """Return every parameter with its default, range and effect."""
    return _page(
        [
            "# Parameters",
            "Set a parameter in the panel, with `--set NAME=VALUE` on the command line, or with "
            "`PATCH /api/parameters`. A change takes effect at the next frame and is recorded "
            "with the run. The column *used by* names the methods, which are the values of "
            "`ego_motion.model`; the command line rejects a parameter that the current method does "
            "not use. *All for the point cloud* means that the dense point cloud of the 3D scene "
            "uses it with every method.",
            "## Basic parameters",
            "The panel shows these first: the eight that matter most with the current method. "
            "`dynamic-observer parameters --basic` lists them too.",
            parameter_table(basic_parameters()),
            "## Presets",
            "The built-in presets differ in these values. [Your own presets]"
            "(presets.md#your-own-presets) explains how to save, share and compare presets.",
            preset_table(),
            "## All parameters",
            *_by_group(AllParameters.declared()),
        ]
    )


def _by_group(entries: list[dict[str, Any]]) -> Iterator[str]:
    for group, members in itertools.groupby(entries, lambda entry: entry["group"]):
        same = list(members)
        yield f"### {group}"
        yield _cell(same[0]["group_help"])
        yield parameter_table(same)


def rest_page() -> str:
    """Return every operation of the REST interface, by subject."""
    described = _described()
    tagged: dict[str, list[tuple[str, str, str]]] = {}
    for path, operations in described["paths"].items():
        for method, operation in operations.items():
            # One without a tag belongs to the server itself, as its metrics do.
            (tag,) = operation.get("tags", ["server"])
            about = [operation["summary"], *operation.get("description", "").split("\n\n")[:1]]
            said = ". ".join(each for each in about if each)
            row = (_code(method.upper()), _code(path), _cell(said))
            tagged.setdefault(tag, []).append(row)
    subjects = {each["name"]: each["description"] for each in described["tags"]}
    parts = [
        "# REST",
        'A running server describes every operation with all fields at <a href="/docs">/docs</a>, '
        'where it can also be tried; <a href="/openapi.json">/openapi.json</a> is the same in '
        "machine-readable form. For a start see [From a script](scripting.md#from-a-script).",
        described["info"]["description"].strip(),
    ]
    for tag, rows in tagged.items():
        parts += [f"## {tag.capitalize()}", subjects.get(tag, "Figures for monitoring.")]
        parts.append(_table(("method", "path", "what it does"), rows))
    return _page(parts)


def glossary_page() -> str:
    """Return every term with its meaning."""
    entries = (
        f"**{term.name}**\n:   {_cell(term.meaning)}"
        + (f" [More]({term.page})." if term.page else "")
        for term in GLOSSARY
    )
    return _page(["# Glossary", *entries])


def _beside_the_code(path: str) -> Callable[[], str]:
    return (ROOT / path).read_text


GENERATED: Mapping[str, Callable[[], str]] = {
    "commands.md": command_page,
    "parameters.md": parameter_page,
    "rest.md": rest_page,
    "glossary.md": glossary_page,
    "guard.md": _beside_the_code("observer/guard/GUARD.md"),
    "external-robot.md": _beside_the_code("observer/robots/EXTERNAL.md"),
}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages and the page's own logo to those that mkdocs found."""
    for name, make in GENERATED.items():
        files.append(File.generated(config, name, content=make()))
    logo = str(ROOT / "static" / "logo.svg")
    files.append(File.generated(config, "images/logo.svg", abs_src_path=logo))
    return files


def _described() -> dict[str, Any]:
    from app.http.server import create_app
    from app.settings import Settings

    with TemporaryDirectory() as folder:
        described: dict[str, Any] = create_app(Settings(data=Path(folder)), "").openapi()
    return described


def _page(parts: list[str]) -> str:
    return "\n\n".join(parts) + "\n"


def _table(header: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [header, ("---",) * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _cell(text: str) -> str:
    """Return a text on one line, in which no character ends a cell or begins an element.

    Code is written with two backticks in docstrings, with one in Markdown.
    """
    flat = " ".join(text.replace("``", "`").split())
    return html.escape(flat, quote=False).replace("|", r"\|")


def _code(text: str) -> str:
    return f"`{text}`".replace("|", r"\|")


def _paragraphs(text: str) -> str:
    return "\n\n".join(" ".join(part.split()) for part in text.split("\n\n"))
