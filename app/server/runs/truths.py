"""Uploaded truth files, and the comparison of runs with them."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import IO, Any

import structlog

from app.contract.commands import LiveTruthOrder
from app.server.errors import FieldError, NotThere
from app.server.runs.archive import RunArchive
from app.server.runs.commands import CommandRefused, RunCommands
from app.server.whole_files import told_as_ours
from app.storage import RunRecord, SpeedRow, Storage, StorageMissing, TruthRecord
from app.storage.comparison import comparison_truth
from observer.errors import DynamicObserverError
from observer.truth.alignment.camera_on_body import CameraOnBody

log = structlog.get_logger(__name__)

_CHUNK = 1 << 20


@dataclass(frozen=True)
class AlignChoices:
    """User's choices for aligning truth with a run.

    Attributes:
        observer: the body that carries the cameras; None: detect it.
        ignore: bodies that are neither observer nor obstacle; they need not be present.
        matches: body of a track (``0:3``), None for none of them.
        expected_offset_s: rough offset to add to the truth's times; None: estimate it.
        camera_on_body: pose on the observer's body; None: estimate it, or take it from the rig.
    """

    observer: str | None = None
    ignore: Sequence[str] = ()
    matches: Mapping[str, str | None] = field(default_factory=dict)
    expected_offset_s: float | None = None
    camera_on_body: CameraOnBody | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "observer": self.observer,
            "ignore": list(self.ignore),
            "matches": dict(self.matches),
            "expected_offset_s": self.expected_offset_s,
            "camera_on_body": None if self.camera_on_body is None else asdict(self.camera_on_body),
        }

    @staticmethod
    def of_alignment(kept: Mapping[str, Any]) -> AlignChoices:
        """Return the choices stored with a run's alignment; those unknown to earlier versions stay
        open.
        """
        plain = kept.get("choices", {})
        camera = plain.get("camera_on_body")
        return AlignChoices(
            plain.get("observer"),
            tuple(plain.get("ignore", ())),
            dict(plain.get("matches", {})),
            plain.get("expected_offset_s"),
            None if camera is None else CameraOnBody(**camera),
        )


@dataclass(frozen=True)
class AlignedRun:
    """Run with the truth laid over it, and the quality of the fit in a sentence."""

    run: RunRecord
    alignment: dict[str, Any] | None
    sentence: str


class TruthFiles:
    """Store of truth files.

    Args:
        commands: commands that read files and align runs.
    """

    def __init__(self, storage: Storage, archive: RunArchive, commands: RunCommands) -> None:
        self._storage = storage
        self._archive = archive
        self._commands = commands

    async def all(self) -> list[TruthRecord]:
        """Return the listed truths, newest first."""
        return await asyncio.to_thread(self._storage.list_truths)

    async def upload(
        self, content: IO[bytes], name: str, rate_hz: float | None, angles: str | None
    ) -> TruthRecord:
        """Read a truth file and store it; the same content is the same truth.

        Args:
            content: read from its beginning. name: file name with its extension.
            rate_hz, angles: as for ``observer.truth.files.recognition.read_capture``.

        Raises:
            FieldError: the file cannot be read, or options for reading it are missing; nothing is
                stored.
            StorageFull: there is no room for it. NotAvailable: the command failed.
        """
        reading = {"rate_hz": rate_hz, "angles": angles}
        async with self._commands.folder() as folder:
            file = folder / f"truth{Path(name).suffix[:9]}"
            with told_as_ours(file):
                await asyncio.to_thread(_copy, content, file)
            output = folder / "understood.json"
            words = ["truth", str(file), "--output", str(output), *_reading_words(reading)]
            try:
                await self._commands.run(*words)
            except CommandRefused as error:
                # The command knows the file by another name.
                sentence = str(error).replace(str(file), name).replace(file.name, name)
                raise FieldError(("body", "file"), sentence) from error
            told = await asyncio.to_thread(_read, output)
            if "question" in told:
                sentence = str(told["question"]).replace(file.name, name)
                raise FieldError(("body", "angles"), sentence)
            keep = partial(
                self._storage.save_truth, file, name=name, format=told["format"],
                info=told | {"reading": reading},
            )  # fmt: skip
            return await asyncio.to_thread(keep)

    async def delete(self, id: str) -> None:
        """Remove a truth from the list; runs compared with it keep it.

        Raises:
            NotThere: there is no truth with that id.
        """
        if not await asyncio.to_thread(self._storage.delete_truth, id):
            raise NotThere(f"there is no truth {id[:80]!r}; GET /api/truth lists them")

    async def align(
        self,
        run_id: str,
        truth_id: str | None,
        choices: AlignChoices,
        *,
        heard_by: str | None = None,
    ) -> AlignedRun:
        """Lay truth over a run; an earlier alignment is replaced only by a successful one.

        Args:
            truth_id: None for the motion capture received live with the run.
            heard_by: the run that received the live motion capture; None: this one.

        Raises:
            NotThere: there is no such run, or it has no recording. Conflict: it is in progress.
            FieldError: there is no such truth, or it cannot be aligned; one sentence says why.
            NotAvailable: the command failed.
        """
        path = await self._archive.recording(run_id)
        kept: dict[str, Any] = {
            "choices": choices.as_dict(),
            "heard_by": heard_by,
        }
        try:
            about = partial(comparison_truth, self._storage, truth_id, kept)
            truth = await asyncio.to_thread(about)
        except StorageMissing as error:
            raise FieldError(("body", "truth_id"), str(error)) from error
        if truth is not None:
            kept["reading"] = {key: truth[key] for key in ("rate_hz", "angles")}
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
        lay = partial(
            self._storage.align_run, run_id, {**(found["alignment"] or {}), **kept},
            truth_id=truth_id, rows=rows,
        )  # fmt: skip
        await asyncio.to_thread(lay)
        return AlignedRun(await self._archive.find(run_id), found["facts"], found["words"])

    async def run_ended(self, run: RunRecord, heard: LiveTruthOrder | None) -> None:
        """Lay the truth that belongs to an ended run over it; failures are only logged.

        This is the live motion capture, which was aligned only some time after it began to arrive,
        or the truth laid over the run that this one re-ran.

        Args:
            heard: live motion capture in use.
        """
        try:
            if run.rerun_of is not None:
                original = await self._archive.find(run.rerun_of)
                if original.aligned:
                    await self._align_again(run.id, original)
            elif heard is not None:
                choices = AlignChoices(heard.observer, heard.ignore)
                await self.align(run.id, None, choices)
        except DynamicObserverError as error:
            log.info("ended_run_not_aligned", run=run.id, reason=str(error))

    async def _align_again(self, run_id: str, original: RunRecord) -> None:
        assert original.alignment is not None
        # Track numbers differ in a re-run, so the user's matches no longer apply.
        choices = replace(AlignChoices.of_alignment(original.alignment), matches={})
        heard_by = None
        if original.truth_id is None:
            heard_by = original.alignment.get("heard_by") or original.id
        await self.align(run_id, original.truth_id, choices, heard_by=heard_by)


def _copy(content: IO[bytes], file: Path) -> None:
    content.seek(0)
    with file.open("wb") as target:
        while chunk := content.read(_CHUNK):
            target.write(chunk)


def _read(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def _reading_words(reading: Mapping[str, Any]) -> list[str]:
    words = []
    if reading["rate_hz"] is not None:
        words.append(f"--rate={reading['rate_hz']!r}")
    if reading["angles"] is not None:
        words.append(f"--angles={reading['angles']}")
    return words


def _truth_words(truth: Mapping[str, Any] | None) -> list[str]:
    if truth is None:
        return []
    return [f"--truth={truth['path']}", f"--name={truth['name']}", *_reading_words(truth)]


def _choice_words(choices: AlignChoices) -> list[str]:
    words = [] if choices.observer is None else [f"--observer={choices.observer}"]
    words += [f"--ignore={body}" for body in choices.ignore]
    if choices.expected_offset_s is not None:
        words.append(f"--expect={choices.expected_offset_s!r}")
    if choices.camera_on_body is not None:
        words.append(f"--camera-on-body={choices.camera_on_body}")
    return words + [f"--match={track}={body or ''}" for track, body in choices.matches.items()]
