"""The viewer's thread and the event loop, whose facts it shows."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

import pytest

from app.server import Server
from app.viewer import ViserViewer
from app.viewer import viewer as viewer_module
from app.viewer.picture import Picture, make_picture

from ...waiting import until_async
from ..http.scene import real_viewer


@pytest.fixture
def viewer(server: Server) -> Iterator[ViserViewer]:
    made = real_viewer(server)
    yield made
    made.stop()


async def test_the_thread_reads_nothing_that_the_event_loop_changes(
    viewer: ViserViewer, server: Server, peer: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    readers: set[int] = set()
    drawn: list[tuple[Any, ...]] = []
    read = server.driving.facts

    def facts() -> Any:
        readers.add(threading.get_ident())
        return read()

    def picture(*given: Any, **more: Any) -> Picture:
        drawn.append((*given, more["limits"]))
        return make_picture(*given, **more)

    monkeypatch.setattr(server.driving, "facts", facts)
    monkeypatch.setattr(viewer_module, "make_picture", picture)
    with viewer.connected():
        peer.observe()
        newest = server.source.latest
        await until_async(lambda: drawn and drawn[-1][0] is newest)
        await server.parameters.change({"guard.speed_max_mps": 0.4})
        peer.observe()
        await until_async(lambda: drawn[-1][0] is server.source.latest)
        _, state, generation, _, driving, limits = drawn[-1]
        assert (state, generation) == (server.source.state, server.source.generation)
        assert driving == read()
        assert limits == server.parameters.current.values.guard
    assert readers == {threading.get_ident()}
    count = len(drawn)
    # Nobody looks any longer: facts are neither read nor drawn.
    readers.clear()
    peer.observe()
    assert not readers
    assert len(drawn) <= count + 1
