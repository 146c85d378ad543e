"""Comparisons of live cameras: the clip saved for one never outlives it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from app.contract.answers import KeptClip
from app.contract.commands import SaveClip, ToEngine
from app.contract.events import StateEvent
from app.server import Server
from app.server.runs import comparing as comparing_module
from app.storage import Storage, StorageFull

from ....waiting import until_async
from ...peer_engine import PeerEngine
from ..servers import started

BOTH = ("paper", "default")


class Cameras(PeerEngine):
    """Live cameras, of which a clip is saved once the test allows it."""

    def __init__(self) -> None:
        super().__init__()
        self.allowed = asyncio.Event()
        self.clip: Path | None = None

    def state(self, **more: Any) -> StateEvent:
        state = super().state(**more)
        return state if state.source is None else replace(state, source=_live(state.source))

    async def request(
        self, command: ToEngine[Any], timeout_s: float = 10.0, *, repeatable: bool = False
    ) -> Any:
        if not isinstance(command, SaveClip):
            return await super().request(command, timeout_s, repeatable=repeatable)
        self.clip = Path(command.path)
        await self.allowed.wait()
        self.clip.parent.mkdir(parents=True, exist_ok=True)
        self.clip.write_bytes(b"not a recording")
        return KeptClip(15, 29.9)


def _live(source: Any) -> Any:
    return replace(source, live=True, frame_count=None)


@pytest.fixture
def cameras() -> Cameras:
    return Cameras()


@pytest.fixture
async def server(cameras: Cameras, storage: Storage) -> AsyncIterator[Server]:
    async with started(cameras, storage, "camera:0,1") as server:
        yield server


async def test_a_full_disk_refuses_a_comparison_and_keeps_no_clip(
    server: Server, cameras: Cameras, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(comparing_module, "_SPARE_BYTES", 1 << 62)
    cameras.allowed.set()
    with pytest.raises(StorageFull, match="free some disk space"):
        await server.runs.methods.start(None, 1.0, BOTH)
    assert cameras.clip is not None
    assert not cameras.clip.exists()
    assert server.runs.methods.facts().going is None


async def test_a_comparison_can_be_cancelled_while_its_clip_is_being_saved(
    server: Server, cameras: Cameras
) -> None:
    starting = asyncio.create_task(server.runs.methods.start(None, 1.0, BOTH))
    await until_async(lambda: cameras.clip is not None)
    going = server.runs.methods.facts().going
    assert going is not None
    assert (going.source_name, going.words) == ("camera:0,1", "starting")
    async with asyncio.timeout(5):
        await server.runs.methods.cancel()
        answer = await starting
    assert (answer.going, answer.runs, answer.trouble) == (None, None, None)
    # The engine cannot be interrupted; what it saves is deleted.
    cameras.allowed.set()
    await _saved_and_deleted(cameras)


async def test_a_comparison_whose_request_ends_is_cancelled(
    server: Server, cameras: Cameras
) -> None:
    starting = asyncio.create_task(server.runs.methods.start(None, 1.0, BOTH))
    await until_async(lambda: cameras.clip is not None)
    starting.cancel()
    await until_async(lambda: server.runs.methods.facts().going is None)
    cameras.allowed.set()
    await _saved_and_deleted(cameras)


async def test_a_comparison_cancelled_before_its_first_step_ends(server: Server) -> None:
    starting = asyncio.create_task(server.runs.methods.start("simulated:lab", 1.0, BOTH))
    # In the same turn of the event loop, before the new task has run.
    cancelling = asyncio.create_task(server.runs.methods.cancel())
    answer, _ = await asyncio.gather(starting, cancelling)
    assert answer.going is None


async def test_a_clip_is_deleted_after_its_comparison_failed(
    server: Server, cameras: Cameras
) -> None:
    cameras.allowed.set()
    assert (await server.runs.methods.start(None, 1.0, BOTH)).going is not None
    await until_async(lambda: server.runs.methods.facts().going is None)
    # The clip is no recording.
    assert server.runs.methods.facts().trouble is not None
    assert cameras.clip is not None
    assert not cameras.clip.exists()


async def _saved_and_deleted(cameras: Cameras) -> None:
    """Wait until the clip has been written, which creates its folder, and deleted again."""
    clip = cameras.clip
    assert clip is not None
    await until_async(clip.parent.exists)
    await until_async(lambda: not clip.exists())
