"""Store of finished tasks, one file each, so that a sweep can be resumed where it was stopped."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

from observer.errors import InputError
from observer.evaluation.result_files import whole_result
from observer.evaluation.sweep.task import Outcome, Task


class TaskStore:
    """Store of the outcomes of finished tasks; failed ones are not kept but retried.

    Args:
        folder: created if it does not exist.

    Raises:
        InputError: the folder cannot be created.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder / "tasks"
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                f"cannot make the folder {self._folder}: {error.strerror}; name a writable one"
            ) from None

    def find(self, task: Task) -> Outcome | None:
        """Return the outcome of an earlier sweep; None without one, or if its file is damaged."""
        try:
            data = json.loads(self._path(task).read_text(encoding="utf-8"))
            return Outcome(**data["outcome"])
        except (OSError, ValueError, TypeError, KeyError):
            return None

    def keep(self, task: Task, outcome: Outcome) -> None:
        """Write an outcome immediately, completely or not at all.

        Raises:
            InputError: the file cannot be written.
        """
        if outcome.error is not None:
            return
        record = {
            "source": task.source.name,
            "extent": task.source.extent,
            "version": task.version,
            "gate_m": task.gate_m,
            "parameters": task.parameters.flat(),
            "outcome": asdict(outcome),
        }
        with whole_result(self._path(task), "; finished results are kept") as part:
            part.write_text(json.dumps(record, allow_nan=False), encoding="utf-8")

    def _path(self, task: Task) -> Path:
        return self._folder / f"{task.key}.json"
