"""Recently opened sources are kept over restarts, without passwords."""

from __future__ import annotations

from typing import Any

from app.server import Server
from app.storage import Storage

from ....waiting import until_async
from ..servers import started


async def test_the_latest_source_is_first_and_all_survive_a_restart(
    peer: Any, storage: Storage
) -> None:
    async with started(peer, storage) as server:
        for spec in ("a/folder", "simulated:people", "a/folder"):
            await server.source.open(spec, None)
        assert server.source.recent.specs == ("a/folder", "simulated:people", "simulated:lab")
        await until_async(lambda: (storage.get_setting("recent_sources") or [""])[0] == "a/folder")
        entries = await server.source.recent.entries()
        assert [entry.spec for entry in entries if entry.recent == 0] == ["a/folder"]


async def test_a_run_is_listed_by_name_until_it_is_deleted(
    server: Server, storage: Storage
) -> None:
    run = storage.create_run(name="Morning", source="b", parameters={}, versions={})
    folder = storage.folder.run(run.id)
    folder.mkdir(parents=True)
    (folder / "recording.mcap").touch()
    await server.source.open(f"run:{run.id}", None)
    spec = f"run:{run.id}"
    assert server.source.recent.specs[0] == spec
    titles = {entry.spec: entry.title for entry in await server.source.recent.entries()}
    assert titles[spec] == "Morning"
    storage.discard_run(run.id)
    assert all(entry.spec != spec for entry in await server.source.recent.entries())


async def test_no_password_is_stored(server: Server) -> None:
    before = server.source.recent.specs
    server.source.recent.opened("rtsp://ada:secret@10.0.0.1/a,rtsp://ada:secret@10.0.0.2/b")
    assert server.source.recent.specs == before
    server.source.recent.opened("rtsp://10.0.0.1/a,rtsp://10.0.0.2/b")
    assert server.source.recent.specs[0] == "rtsp://10.0.0.1/a,rtsp://10.0.0.2/b"


async def test_damaged_entries_are_skipped(peer: Any, storage: Storage) -> None:
    storage.open()
    storage.set_setting("recent_sources", ["simulated:people", 7, None])
    async with started(peer, storage) as server:
        await until_async(lambda: len(server.source.recent.specs) > 1)
        assert server.source.recent.specs == ("simulated:lab", "simulated:people")
