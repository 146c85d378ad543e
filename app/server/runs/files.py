"""Files made from a run on request: its chart, its report, and exports for other tools."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Literal

from app.contract.values import plain
from app.server.errors import Conflict
from app.server.runs.archive import RunArchive
from app.server.runs.commands import CommandRefused, RunCommands
from app.server.runs.frame_window import some_frames
from app.server.runs.row_charts import chart_of_rows
from app.storage import RunRecord, Storage, StorageFull
from app.storage.comparison import kept_comparison
from observer.recording.run_folder import RECORDING
from observer.version import library_version
from observer.whole_files import whole_file

ChartFormat = Literal["csv", "png", "svg", "pdf"]
ExportFormat = Literal["zip", "csv", "parquet", "mp4", "ply", "ros2"]

# Prefixes of cache files, which users do not access by name.
_CHART, _FRAMES = ".chart-", ".frames-"
# Version of the content of these files; change it when a field is added.
_FORM = 4
# Results are far smaller than the run's recording; this much space stays free.
_SPARE_BYTES = 100 << 20
_IN_NO_NAME = '/\\:*?"<>|'
_LONGEST_STEM = 80
_QUICK_S, _LONG_S = 120.0, 1800.0


@dataclass(frozen=True)
class MadeFile:
    """File without a name, which is deleted once it is closed.

    Attributes:
        file: open at its beginning. size: bytes. name: file name for the recipient.
    """

    file: IO[bytes]
    size: int
    name: str


class RunFiles:
    """Files of finished runs, made by commands; see ``RunCommands``."""

    def __init__(self, storage: Storage, archive: RunArchive) -> None:
        self._storage = storage
        self._archive = archive
        # Two queues, so that a chart does not wait for a video.
        self.quick = RunCommands(storage.folder, time_limit_s=_QUICK_S)
        self._long = RunCommands(storage.folder, time_limit_s=_LONG_S)

    async def chart(self, run: RunRecord) -> bytes:
        """Return the values of a run's chart as JSON, see ``app.reports.run_chart.chart_values``.

        For a run in progress or without a recording they come from the database, without error
        figures.

        Raises:
            Conflict: its recording or its truth cannot be read. NotAvailable: the command failed.
        """
        path = self._storage.folder.run(run.id) / RECORDING
        if self._archive.is_going(run.id) or not await asyncio.to_thread(path.is_file):
            rows = await asyncio.to_thread(self._storage.speeds, run.id)
            return await asyncio.to_thread(lambda: json.dumps(plain(chart_of_rows(rows))).encode())
        return await self._kept(run, path, _CHART, "chart")

    async def frames(
        self, run: RunRecord, first: int = 0, count: int | None = None, most: int | None = None
    ) -> bytes:
        """Return the results of frames as JSON, see ``app.contract.run_frames``.

        Args:
            first: position of the first frame, from 0. count: number of frames; None: all the rest.
            most: maximum number of frames to return; if there are more, an evenly spaced subset.

        Raises:
            NotThere: the run has no recording. Conflict: its recording is being written, or it or
                its truth cannot be read. NotAvailable: the command failed.
        """
        path = await self._archive.recording(run.id)
        content = await self._kept(run, path, _FRAMES, "frames")
        if first == 0 and count is None and most is None:
            return content
        return await asyncio.to_thread(some_frames, content, first, count, most)

    def keep_frames(self, run: RunRecord, content: bytes) -> None:
        """Cache content for ``frames`` that has already been made elsewhere."""
        path = self._storage.folder.run(run.id) / RECORDING
        _keep(_kept_file(run, path, _FRAMES), _FRAMES, content)

    async def _kept(self, run: RunRecord, path: Path, prefix: str, command: str) -> bytes:
        """Return the JSON that a command makes of a run, cached after the first time."""
        kept = await asyncio.to_thread(_kept_file, run, path, prefix)
        with contextlib.suppress(OSError):
            return await asyncio.to_thread(kept.read_bytes)
        made = await self._made(run, self.quick, command, f"{command}.json")
        content = await asyncio.to_thread(_content, made)
        await asyncio.to_thread(_keep, kept, prefix, content)
        return content

    async def chart_file(
        self, run: RunRecord, format: ChartFormat, begin: float | None, end: float | None
    ) -> MadeFile:
        """Make the chart between two instants of the run's clock, seconds; None: start or end.

        Raises:
            Conflict, NotAvailable: as for ``chart``.
        """
        options = ["--title", run.name]
        # One word, because a negative number would look like an option.
        options += [] if begin is None else [f"--begin={begin!r}"]
        options += [] if end is None else [f"--end={end!r}"]
        return await self._made(run, self.quick, "chart", f"speeds.{format}", options)

    async def report(self, run: RunRecord) -> MadeFile:
        """Make one page with the paper's figures, reproduced from the run.

        Raises:
            Conflict, NotAvailable: as for ``chart``.
        """
        return await self._made(run, self._long, "report", "report.html")

    async def export(self, run: RunRecord, format: ExportFormat, table: str | None) -> MadeFile:
        """Export the run for other tools; ``table`` applies to csv and parquet.

        Raises:
            Conflict: the recording has no such data. NotAvailable: the command failed.
            StorageFull: there is no room for the file.
        """
        path = await self._archive.recording(run.id)
        needed = (await asyncio.to_thread(path.stat)).st_size + _SPARE_BYTES
        if await asyncio.to_thread(self._storage.folder.free_bytes) < needed:
            raise StorageFull("no space is left to make the file; free some disk space")
        if format == "ros2":
            return await self._bag(run, path)
        options = ["--table", table] if table is not None else []
        name = f"{table or 'run'}.{format}"
        async with self._long.folder() as folder:
            output = folder / name
            await _asked(self._long.run("export", str(path), "--output", str(output), *options))
            return await _opened(output, f"{file_stem(run)}-{name}")

    async def _bag(self, run: RunRecord, path: Path) -> MadeFile:
        async with self._long.folder() as folder:
            bag, output = folder / "bag", folder / "bag.zip"
            await _asked(self._long.run("export", str(path), "--ros2", "--output", str(bag)))
            await _asked(self._long.run("-c", str(output), str(bag), module="zipfile"))
            return await _opened(output, f"{file_stem(run)}-bag.zip")

    async def _made(
        self,
        run: RunRecord,
        commands: RunCommands,
        command: str,
        name: str,
        options: Sequence[str] = (),
    ) -> MadeFile:
        """Run a command that compares a run's recording with truth, and return its file."""
        path = await self._archive.recording(run.id)
        async with commands.folder() as folder:
            words = [command, str(path.absolute()), "--output", str(folder / name), *options]
            words += await compared_words(self._storage, run, folder)
            await _asked(commands.run(*words))
            return await _opened(folder / name, f"{file_stem(run)}-{name}")


def file_stem(run: RunRecord) -> str:
    """Return the run's name reduced to characters valid in file names; its id if none remain."""
    name = "".join("_" if c in _IN_NO_NAME or not c.isprintable() else c for c in run.name)
    return name.strip(" .")[:_LONGEST_STEM] or run.id


async def compared_words(storage: Storage, run: RunRecord, folder: Path) -> list[str]:
    """Return the option that passes a run's truth to a command."""
    if run.alignment is None:
        return []
    kept = await asyncio.to_thread(kept_comparison, run, storage)
    file = folder / "compared.json"
    await asyncio.to_thread(file.write_text, json.dumps(kept), encoding="utf-8")
    return ["--compared", str(file)]


async def _asked(work: Any) -> None:
    try:
        await work
    except CommandRefused as error:
        raise Conflict(str(error)) from error


async def _opened(path: Path, name: str) -> MadeFile:
    """Open the file; it stays readable after its folder has been deleted."""
    file = await asyncio.to_thread(path.open, "rb")
    return MadeFile(file, path.stat().st_size, name)


def _content(made: MadeFile) -> bytes:
    with made.file as file:
        return file.read()


def _kept_file(run: RunRecord, recording: Path, prefix: str) -> Path:
    """Return the path of a cache file, whose name changes whenever its content may change."""
    stat = recording.stat()
    facts = [_FORM, library_version(), stat.st_size, stat.st_mtime_ns, run.alignment, run.truth_id]
    key = hashlib.sha256(json.dumps(facts).encode()).hexdigest()[:16]
    return recording.with_name(f"{prefix}{key}.json")


def _keep(path: Path, prefix: str, content: bytes) -> None:
    """Cache the content; if it cannot be written, it is made again next time."""
    with contextlib.suppress(OSError):
        for old in path.parent.glob(f"{prefix}*"):
            old.unlink(missing_ok=True)
        with whole_file(path) as part:
            part.write_bytes(content)
