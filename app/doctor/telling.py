"""Findings as lines for people."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby

from rich.console import Console
from rich.text import Text

from app.doctor.examination import Examination
from app.doctor.finding import Level

# Mark in front of a finding, with its style.
_Marks = dict[Level, tuple[str, str]]
_PLAIN: _Marks = {"ok": ("ok     ", ""), "warning": ("warning", ""), "problem": ("PROBLEM", "")}
_DRAWN: _Marks = {"ok": ("✓", "green"), "warning": ("!", "yellow"), "problem": ("✗", "bold red")}


def tell(examination: Examination, console: Console) -> None:
    """Print to the console, with marks and colours if it is a terminal that supports them."""
    if console.is_terminal and console.encoding.lower().startswith("utf"):
        for line in _lines(examination, _DRAWN, " "):
            # Sentences are not wrapped, so that commands in them can be copied.
            console.print(line, soft_wrap=True)
    else:
        console.file.writelines(f"{line}\n" for line in _lines(examination, _PLAIN, "  "))


def _lines(examination: Examination, marks: _Marks, space: str) -> Iterator[Text]:
    for section, findings in groupby(examination.findings, key=lambda each: each.section):
        yield Text(section, style="bold")
        for finding in findings:
            mark, style = marks[finding.level]
            yield Text.assemble("  ", (mark, style), f"{space}{finding.text}")
            indent = " " * (len(mark) + len(space) + 4)
            yield from (Text(f"{indent}{detail}", style="dim") for detail in finding.details)
    yield Text(_verdict(examination), style="bold")


def _verdict(examination: Examination) -> str:
    levels = [finding.level for finding in examination.findings]
    problems, warnings = levels.count("problem"), levels.count("warning")
    if problems:
        prevent = "problem prevents" if problems == 1 else "problems prevent"
        return f"{problems} {prevent} the start."
    if warnings:
        need = "warning needs" if warnings == 1 else "warnings need"
        return f"Nothing prevents the start; {warnings} {need} attention."
    return "Nothing prevents the start."
