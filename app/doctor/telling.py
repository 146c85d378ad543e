"""Findings as lines for people."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby

from rich.console import Console
from rich.text import Text

from app.doctor.examination import Examination
from app.doctor.finding import Level

_PLAIN: dict[Level, str] = {"ok": "ok     ", "warning": "warning", "problem": "PROBLEM"}
_MARKS: dict[Level, tuple[str, str]] = {
    "ok": ("✓", "green"),
    "warning": ("!", "yellow"),
    "problem": ("✗", "bold red"),
}


def tell(examination: Examination, console: Console) -> None:
    """Print to the console, with marks and colours if it is a terminal that supports them."""
    if console.is_terminal and console.encoding.lower().startswith("utf"):
        for line in marked_lines(examination):
            # Sentences are not wrapped, so that commands in them can be copied.
            console.print(line, soft_wrap=True)
    else:
        console.file.write("\n".join([*plain_lines(examination), ""]))


def plain_lines(examination: Examination) -> Iterator[str]:
    """Yield lines for files and pipes."""
    for section, findings in groupby(examination.findings, key=lambda each: each.section):
        yield section
        for finding in findings:
            yield f"  {_PLAIN[finding.level]}  {finding.text}"
            yield from (f"{'':13}{detail}" for detail in finding.details)
    yield _verdict(examination)


def marked_lines(examination: Examination) -> Iterator[Text]:
    """Yield lines for terminals."""
    for section, findings in groupby(examination.findings, key=lambda each: each.section):
        yield Text(section, style="bold")
        for finding in findings:
            mark, style = _MARKS[finding.level]
            yield Text.assemble("  ", (mark, style), f" {finding.text}")
            yield from (Text(f"      {detail}", style="dim") for detail in finding.details)
    yield Text(_verdict(examination), style="bold")


def _verdict(examination: Examination) -> str:
    levels = [finding.level for finding in examination.findings]
    problems, warnings = levels.count("problem"), levels.count("warning")
    if problems:
        return f"{problems} of these {'hinders' if problems == 1 else 'hinder'} the start."
    if warnings:
        return f"Nothing hinders the start; {warnings} of these should be seen to."
    return "Nothing hinders the start."
