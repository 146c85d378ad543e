"""Small pictures of sources, made once and kept in the data folder."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
from collections.abc import Awaitable, Callable
from pathlib import Path

from app.contract.sources import SourceEntry
from app.runtime.worker import JobFailed
from app.server.errors import NotThere
from app.workers.thumbnails.process import picture
from observer.opening import simulated_world, source_kind
from observer.simulation.scenarios import load_scenario
from observer.version import library_version
from observer.whole_files import whole_file

FOLDER = "thumbnails"
# A large folder is indexed before its first image is read.
_LONGEST_S = 60.0
# About 8 kB each.
_MOST = 200


class Thumbnails:
    """Pictures of sources, made one at a time; used in the event loop.

    Args:
        folder: holds the pictures; it need not exist.
        make: returns the picture of a spec.
    """

    def __init__(self, folder: Path, make: Callable[[str], Awaitable[bytes]] = picture) -> None:
        self._folder = folder
        self._make = make
        self._one = asyncio.Lock()
        # Sources without a picture, by the path it would have, and the reason.
        self._without: dict[Path, str] = {}

    async def find(self, entry: SourceEntry) -> bytes:
        """Return the JPEG of a source; cancelling also stops making it.

        Raises:
            NotThere: there is no picture of it.
        """
        if not entry.picture:
            raise NotThere(f"there is no picture of {entry.title}")
        kept = self._folder / f"{await asyncio.to_thread(_key, entry.spec)}.jpg"
        with contextlib.suppress(OSError):
            return await asyncio.to_thread(kept.read_bytes)
        async with self._one:
            # It may have been made while this waited for the lock.
            with contextlib.suppress(OSError):
                return await asyncio.to_thread(kept.read_bytes)
            content = await self._made(entry, kept)
            await asyncio.to_thread(_keep, kept, content)
            return content

    async def _made(self, entry: SourceEntry, kept: Path) -> bytes:
        if kept not in self._without:
            try:
                async with asyncio.timeout(_LONGEST_S):
                    return await self._make(entry.spec)
            except JobFailed as error:
                self._without[kept] = str(error)
            except TimeoutError:
                self._without[kept] = "it took too long"
        raise NotThere(f"there is no picture of {entry.title}: {self._without[kept]}")


def _key(spec: str) -> str:
    """Return a name that changes whenever the picture would change."""
    state = "gone"
    if source_kind(spec) == "simulated":
        scenario = load_scenario(simulated_world(spec)[0])
        state = f"{library_version()} {scenario.model_dump_json()}"
    else:
        with contextlib.suppress(OSError):
            state = str(Path(spec).stat().st_mtime_ns)
    return hashlib.sha256(f"{spec} {state}".encode()).hexdigest()[:32]


def _keep(path: Path, content: bytes) -> None:
    """Write a picture; if there is no space for it, it is made again next time."""
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as part:
            part.write_bytes(content)
        by_age = sorted(path.parent.glob("*.jpg"), key=lambda each: each.stat().st_mtime_ns)
        for old in by_age[:-_MOST]:
            old.unlink(missing_ok=True)
