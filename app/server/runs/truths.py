"""Uploaded ground-truth files, and the comparison of runs with them."""

from __future__ import annotations

import asyncio
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import structlog

from app.contract.commands import LiveTruthOrder
from app.contract.runs import AlignChoicesEntry, AlignedRunEntry, AlignmentFacts
from app.contract.truths import TruthEntry, TruthInfo, TruthReading
from app.contract.values import JsonObject, filled, of_plain, plain
from app.server.data_files import storage_errors
from app.server.errors import FieldError, NotThere
from app.server.runs.archive import RunArchive
from app.server.runs.commands import CommandRefused, RunCommands
from app.storage import RunRecord, SpeedRow, Storage, StorageMissing, TruthRecord
from app.storage.comparison import StoredTruth, comparison_truth
from observer.errors import DynamicObserverError
from observer.truth.alignment.camera_on_body import CameraOnBody
from observer.truth.files.known import AngleReading

log = structlog.get_logger(__name__)

_CHUNK = 1 << 20


_ALL_OPEN = AlignChoicesEntry(None, (), {}, None, None)


def kept_choices(run: RunRecord) -> AlignChoicesEntry | None:
    """Return the choices stored with a run's alignment; None without one.

    Choices that an earlier version did not store stay open.
    """
    if run.alignment is None:
        return None
    return of_plain(AlignChoicesEntry, vars(_ALL_OPEN) | run.alignment.get("choices", {}))


class TruthFiles:
    """Stores truth files and adds them to runs.

    Args:
        commands: runs the commands that read files and align runs.
    """

    def __init__(self, storage: Storage, archive: RunArchive, commands: RunCommands) -> None:
        self._storage = storage
        self._archive = archive
        self._commands = commands

    async def all(self) -> list[TruthEntry]:
        """Return the listed truths, newest first."""
        return [truth_entry(each) for each in await asyncio.to_thread(self._storage.list_truths)]

    async def upload(
        self, content: IO[bytes], name: str, rate_hz: float | None, angles: AngleReading | None
    ) -> TruthEntry:
        """Read a truth file and store it; uploading the same content again adds no second truth.

        Args:
            content: read from its beginning. name: file name with its extension.
            rate_hz, angles: as for ``observer.truth.files.recognition.read_capture``.

        Raises:
            FieldError: the file cannot be read, or options for reading it are missing; nothing is
                stored.
            StorageFull: there is no room for it. NotAvailable: the command failed.
        """
        reading = TruthReading(rate_hz, angles)
        async with self._commands.folder() as folder:
            file = folder / f"truth{Path(name).suffix[:9]}"
            with storage_errors(file):
                await asyncio.to_thread(_copy, content, file)
            output = folder / "understood.json"
            words = ["truth", str(file), "--output", str(output), *_reading_words(reading)]
            try:
                await self._commands.run(*words)
            except CommandRefused as error:
                # The command uses a temporary name for the file.
                sentence = str(error).replace(str(file), name).replace(file.name, name)
                raise FieldError(("body", "file"), sentence) from error
            answer = await asyncio.to_thread(_read, output)
            if "question" in answer:
                sentence = str(answer["question"]).replace(file.name, name)
                raise FieldError(("body", "angles"), sentence)
            info = answer | {"reading": vars(reading)}
            save = self._storage.save_truth
            return truth_entry(
                await asyncio.to_thread(save, file, name=name, format=answer["format"], info=info)
            )

    async def delete(self, id: str) -> None:
        """Remove a truth from the list; runs compared with it keep it.

        Raises:
            NotThere: there is no truth with that id.
        """
        if not await asyncio.to_thread(self._storage.delete_truth, id):
            raise NotThere(f"there is no ground truth {id[:80]!r}; it may have been deleted")

    async def align(
        self,
        run_id: str,
        truth_id: str | None,
        choices: AlignChoicesEntry,
        *,
        heard_by: str | None = None,
    ) -> AlignedRunEntry:
        """Add ground truth to a run; an earlier alignment is replaced only by a successful one.

        Args:
            truth_id: None for the motion capture received live with the run.
            heard_by: the run that received the live motion capture; None: this one.

        Raises:
            NotThere: there is no such run, or it has no recording. Conflict: it is in progress.
            FieldError: there is no such truth, or it cannot be aligned; one sentence says why.
            NotAvailable: the command failed.
        """
        path = await self._archive.recording(run_id)
        kept: JsonObject = {"choices": plain(choices), "heard_by": heard_by}
        try:
            truth = await asyncio.to_thread(comparison_truth, self._storage, truth_id, kept)
        except StorageMissing as error:
            raise FieldError(("body", "truth_id"), str(error)) from error
        if truth is not None:
            kept["reading"] = vars(truth.reading)
        async with self._commands.folder() as folder:
            output, speeds = folder / "compared.json", folder / "speeds.json"
            words = ["align", str(path.absolute()), "--output", str(output)]
            words += ["--speeds", str(speeds), *_truth_words(truth), *_choice_words(choices)]
            try:
                await self._commands.run(*words)
            except CommandRefused as error:
                raise FieldError(("body",), str(error)) from error
            found = await asyncio.to_thread(_read, output)
            rows = [
                SpeedRow(run_id=run_id, source="truth", std=None, **row)
                for row in await asyncio.to_thread(_read, speeds)
            ]
        alignment = {**(found["alignment"] or {}), **kept}
        lay = self._storage.align_run
        await asyncio.to_thread(lay, run_id, alignment, truth_id=truth_id, rows=rows)
        facts = None if found["facts"] is None else of_plain(AlignmentFacts, found["facts"])
        run = await self._archive.find(run_id)
        return filled(AlignedRunEntry, run, alignment=facts, sentence=found["words"])

    async def run_ended(self, run: RunRecord, heard: LiveTruthOrder | None) -> None:
        """Add its truth to a run that has ended; failures are only logged.

        For a re-run, that is the truth added to the original run. Otherwise it is the live motion
        capture, which during the run was aligned only some time after it began to arrive.

        Args:
            heard: live motion capture in use.
        """
        try:
            if run.rerun_of is not None:
                original = await self._archive.find(run.rerun_of)
                if original.aligned:
                    await self._align_again(run.id, original)
            elif heard is not None:
                choices = replace(_ALL_OPEN, observer=heard.observer, ignore=heard.ignore)
                await self.align(run.id, None, choices)
        except DynamicObserverError as error:
            log.info("ended_run_not_aligned", run=run.id, reason=str(error))

    async def _align_again(self, run_id: str, original: RunRecord) -> None:
        choices = kept_choices(original)
        assert original.alignment is not None
        assert choices is not None
        # Track numbers differ in a re-run, so the user's matches no longer apply.
        choices = replace(choices, matches={})
        heard_by = None
        if original.truth_id is None:
            heard_by = original.alignment.get("heard_by") or original.id
        await self.align(run_id, original.truth_id, choices, heard_by=heard_by)


def truth_entry(record: TruthRecord) -> TruthEntry:
    """Return a truth file as it is listed."""
    try:
        info = of_plain(TruthInfo, record.info)
    except ValueError:
        # The stored facts were damaged by hand, but the file itself is intact: list it by name.
        notes = ["the facts stored about this file are damaged; upload it again to restore them"]
        info = TruthInfo(record.format, None, None, (), notes, TruthReading(None, None))
    return filled(TruthEntry, record, info=info)


def _copy(content: IO[bytes], file: Path) -> None:
    content.seek(0)
    with file.open("wb") as target:
        shutil.copyfileobj(content, target, _CHUNK)


def _read(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def _reading_words(reading: TruthReading) -> list[str]:
    words = []
    if reading.rate_hz is not None:
        words.append(f"--rate={reading.rate_hz!r}")
    if reading.angles is not None:
        words.append(f"--angles={reading.angles}")
    return words


def _truth_words(truth: StoredTruth | None) -> list[str]:
    if truth is None:
        return []
    path = truth.path.absolute()
    return [f"--truth={path}", f"--name={truth.name}", *_reading_words(truth.reading)]


def _choice_words(choices: AlignChoicesEntry) -> list[str]:
    words = [] if choices.observer is None else [f"--observer={choices.observer}"]
    words += [f"--ignore={body}" for body in choices.ignore]
    if choices.expected_offset_s is not None:
        words.append(f"--expect={choices.expected_offset_s!r}")
    if choices.camera_on_body is not None:
        words.append(f"--camera-on-body={CameraOnBody(**vars(choices.camera_on_body))}")
    return words + [f"--match={track}={body or ''}" for track, body in choices.matches.items()]
