"""Display names of sources, and the way back from a run's recording."""

from __future__ import annotations

import pytest

from app.server import Conflict, Server
from app.server.status import status

from ....waiting import until_async
from ..servers import begin


async def recorded(server: Server) -> str:
    run = server.storage.create_run(name="Morning", source="b", parameters={}, versions={})
    folder = server.storage.folder.run(run.id)
    folder.mkdir(parents=True)
    (folder / "recording.mcap").touch()
    return run.id


def told(server: Server) -> tuple[str, str | None]:
    source = status(server).source
    assert source is not None
    return source.name, source.before


@pytest.mark.parametrize("clip", ["clip-1.mcap", "ring-1.mcap"])
async def test_a_recording_has_its_runs_name_and_can_be_left_again(
    server: Server, clip: str
) -> None:
    id = await recorded(server)
    assert told(server) == ("simulated:lab", None)
    with pytest.raises(Conflict, match="no previous source"):
        await server.source.go_back()
    await server.source.open(f"run:{id}", None)
    await until_async(lambda: told(server) == ("Recording of Morning", "simulated:lab"))
    await server.runs.history.annotate(id, name="Evening")
    assert told(server) == ("Recording of Evening", "simulated:lab")
    # Going from one recording to another keeps the way back.
    await server.source.open(str(server.storage.folder.run(id).absolute() / clip), None)
    await until_async(lambda: told(server) == ("Saved clip of Evening", "simulated:lab"))
    run = await begin(server)
    assert (run.source_name, run.name) == ("Saved clip of Evening", "Saved clip of Evening")
    with pytest.raises(Conflict, match="stop it"):
        await server.source.go_back()
    await server.runs.stop(run.id)
    await server.source.go_back()
    await until_async(lambda: told(server) == ("simulated:lab", None))


async def test_the_name_of_a_deleted_run_is_not_shown(server: Server) -> None:
    id = await recorded(server)
    path = str(server.storage.folder.run(id).absolute() / "recording.mcap")
    assert server.storage.recording_name(path) == "Recording of Morning"
    run = server.storage.create_run(name="again", source=path, parameters={}, versions={})
    assert run.source_name == "Recording of Morning"
    server.storage.delete_run(id)
    assert server.storage.recording_name(path) is None
    found = server.storage.get_run(run.id)
    assert found is not None
    assert found.source_name == path
