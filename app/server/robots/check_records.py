"""Records of guided checks: dated JSON files for programs, each with a Markdown file for people."""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

from app.contract.robots import CheckEntry, CheckRecord
from app.contract.values import filled, of_plain, plain
from app.server.data_files import storage_errors, write_whole
from app.server.errors import Conflict, NotThere
from app.server.robots.circumstances import Circumstances
from observer.rig.rig import Role

_NAME = re.compile(r"\d{4}-\d\d-\d\dT\d{4}-(observer|obstacle)(-\d{1,3})?", re.ASCII)
_LISTED = 100
_MOST_BYTES = 1_000_000
_MOST_ALIKE = 999
# A check older than a month should be repeated.
_LASTS = timedelta(days=30)
# Outcomes that are displayed under another name than in the record.
_OUTCOMES = {"given_up": "aborted"}


class CheckRecords:
    """Reader and writer of the record files; call it in a thread.

    Args:
        folder: folder of the records; None: nothing is stored.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder

    def save(self, record: CheckRecord) -> str:
        """Store a record under a new name and return the name; never overwrite a record.

        Raises:
            Conflict: this server stores no records. FieldError, StorageFull: it cannot be written.
        """
        if self._folder is None:
            raise Conflict("this server keeps no records of checks")
        name = self._reserved(f"{_started(record):%Y-%m-%dT%H%M}-{record.role}")
        text = json.dumps({"name": name, **plain(record)}, indent=2, allow_nan=False) + "\n"
        for_people, for_programs = self._file(name, "md"), self._file(name, "json")
        try:
            write_whole(for_people, markdown(record))
            write_whole(for_programs, text)
        except BaseException:
            for file in (for_people, for_programs):
                with contextlib.suppress(OSError):
                    file.unlink()
            raise
        return name

    def _reserved(self, stem: str) -> str:
        """Reserve a unique name by creating its JSON file, empty."""
        assert self._folder is not None
        with storage_errors(self._folder):
            self._folder.mkdir(parents=True, exist_ok=True)
            for number in range(1, _MOST_ALIKE + 1):
                name = stem if number == 1 else f"{stem}-{number}"
                with contextlib.suppress(FileExistsError), self._file(name, "json").open("x"):
                    return name
        raise Conflict(f"there are already {_MOST_ALIKE} records named {stem}; wait a minute")

    def all(self) -> list[CheckEntry]:
        """Return list entries of the newest hundred records, newest first; skip invalid files."""
        return [
            filled(CheckEntry, record, name=name, states={s.name: s.state for s in record.steps})
            for name, record in self._newest()
        ]

    def newest(self, role: Role) -> CheckRecord | None:
        """Return the newest record of a role, except aborted checks."""
        found = (each for _, each in self._newest() if each.role == role)
        return next((each for each in found if each.outcome != "given_up"), None)

    def text(self, name: str, suffix: str) -> str:
        """Return the text of a record's file, ``json`` or ``md``.

        Raises:
            NotThere: there is no record of this name.
        """
        # Only names from a listing of the folder may become paths.
        if name in self._names():
            with contextlib.suppress(OSError, UnicodeDecodeError):
                text = self._file(name, suffix).read_text(encoding="utf-8")
                if text:
                    return text
        raise NotThere(f"there is no check {name[:80]!r}; it may have been deleted")

    def _newest(self) -> Iterator[tuple[str, CheckRecord]]:
        """Yield the newest hundred valid records with their names, newest first."""
        for name in self._names()[:_LISTED]:
            with contextlib.suppress(OSError, ValueError, OverflowError, RecursionError):
                file = self._file(name, "json")
                if file.stat().st_size <= _MOST_BYTES:
                    record = of_plain(CheckRecord, json.loads(file.read_text(encoding="utf-8")))
                    _started(record)
                    if record.outcome is not None and record.role in name:
                        yield name, record

    def _file(self, name: str, suffix: str) -> Path:
        assert self._folder is not None
        return self._folder / f"{name}.{suffix}"

    def _names(self) -> list[str]:
        """Return the names, newest first."""
        if self._folder is None:
            return []
        try:
            names = [each.stem for each in self._folder.iterdir() if each.suffix == ".json"]
        except OSError:
            return []
        return sorted(filter(_NAME.fullmatch, names), key=_age, reverse=True)


def _age(name: str) -> tuple[str, int, str]:
    stem, _, number = name.partition("-ob")
    last = number.rpartition("-")[2]
    return stem, int(last) if last.isdigit() else 1, number


def _started(record: CheckRecord) -> datetime:
    return datetime.fromisoformat(record.started_at).astimezone(UTC)


def advice(newest: CheckRecord | None, now: Circumstances, today: datetime) -> str | None:
    """Return why to check again, in one sentence; None while the newest check is still valid."""
    if newest is None:
        return "The guard has not been checked yet: check it before you rely on it."
    why = []
    age = today - _started(newest)
    if age > _LASTS:
        why.append(f"the latest check is {age.days} days old")
    changed = now.differences(newest)
    if changed:
        why.append(f"{' and '.join(changed)} changed since the latest check")
    if newest.outcome == "failed":
        why.append("the latest check failed")
    if newest.outcome == "incomplete":
        why.append("steps of the latest check were skipped")
    return f"Check again: {', and '.join(why)}." if why else None


def markdown(record: CheckRecord) -> str:
    """Format a record for people."""
    robot = record.robot
    lines = [
        f"# Guard check, {record.role}, {record.started_at}",
        "",
        f"Outcome: **{_OUTCOMES.get(str(record.outcome), record.outcome)}**"
        + (f" by {_text(record.given_up_by)}" if record.given_up_by else ""),
        "",
        f"- Robot: {_text(robot.name)}, model {_text(robot.model)}, "
        f"own watchdog {_figure(robot.watchdog_s, ' s')}",
        f"- Driven by: {', '.join(map(_text, record.operators)) or '-'}; started by "
        f"{_text(record.started_by)}",
        f"- Source: {_text(record.source)}",
        f"- Calibration: {_text(record.calibration or 'the one of the source')}; rig: {record.rig}",
        f"- Software: {', '.join(f'{k} {v}' for k, v in record.software.items())}",
    ]
    if record.note:
        lines.append(f"- Note: {_text(record.note)}")
    if record.changed_meanwhile:
        lines.append(f"- Changed during the check: {', '.join(record.changed_meanwhile)}")
    lines += [
        "",
        f"Limit: stop command within {record.promised_ms:.0f} ms of the cause. A dash means not "
        "reported.",
        "",
        "| Step | State | Speed, m/s | Stop command, ms | Standstill, ms | Distance, m | "
        "Clearance, m | Verdict |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for step in record.steps:
        names = ("speed_mps", "zero_ms", "stood_ms", "distance_m", "separation_m")
        cells = [_figure(getattr(step.figures, name, None)) for name in names]
        skipped = f"skipped by {_text(step.skipped_by)}" if step.skipped_by else None
        row = [step.title, step.state, *cells, _text(step.verdict or skipped or step.told)]
        lines.append(f"| {' | '.join(row)} |")
    lines += ["", "Guard parameters:", ""]
    lines += [f"- {name}: {value}" for name, value in record.guard.items()]
    return "\n".join(lines) + "\n"


def _figure(value: float | None, unit: str = "") -> str:
    return "-" if value is None else f"{value:g}{unit}"


def _text(value: str | None) -> str:
    """Escape a user's text for one table cell, without markup."""
    plain = "".join(c if c.isprintable() else " " for c in value or "-")
    return re.sub(r"([\\`*_\[\]<>|])", r"\\\1", plain)
