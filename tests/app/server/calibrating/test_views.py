"""Calibrating over a peer engine: views outlive engines, nothing stays open."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import Any

import pytest

from app.contract.calibrating import CapturedView
from app.contract.commands import BeginCalibration, ChangeCalibration, CloseSource, OpenSource
from app.contract.events import EngineState, Event, StateEvent
from app.runtime.errors import ProcessRefused
from app.server import Conflict, FieldError, NotAvailable, NotThere, Server
from app.server.status import status
from app.storage import Storage
from observer.calibration.boards.board import Board, BoardSighting, BoardView

from ....waiting import until_async
from ...engine_values import sighting_of
from ..servers import begin, opens, started
from .capturing import (
    BOARD,
    CAMERAS,
    CAPTURE,
    Computing,
    begin_requests,
    captured,
    names,
)

# --- beginning and leaving ------------------------------------------------------------------


async def test_views_survive_the_engine_and_numbering_continues(peer: Any, server: Server) -> None:
    await captured(peer, server)
    await server.calibrating.change(ChangeCalibration(undo=True))
    await server.calibrating.change(ChangeCalibration(automatic=False))
    peer.lose("the engine was killed")
    assert server.source.state.state is EngineState.FAILED
    assert names(server) == ["1", "2"]
    peer.start_process()
    await until_async(lambda: server.source.state.state is EngineState.CALIBRATING)
    again = begin_requests(peer)[-1]
    assert (again.source, again.board, again.automatic) == (CAMERAS, BOARD, False)
    assert [view.name for view in again.views] == ["1", "2"]
    await server.calibrating.change(CAPTURE)
    assert names(server) == ["1", "2", "3"]
    assert server.calibrating.session.picture("1", 0).startswith(b"\xff\xd8")
    # Nothing else was opened behind the calibration's back.
    assert len(opens(peer)) == 1


async def test_other_work_is_refused_while_calibrating(
    peer: Any, storage: Storage, calibration_yaml: Any, server: Server
) -> None:
    record = storage.save_calibration(calibration_yaml(), name="x", info={})
    await captured(peer, server, 1)
    none: dict[str, Any] = {"name": None, "source": None, "calibration_id": None}
    for refused in (
        server.source.open("a/folder", None),
        server.runs.start(**none, preset=None, parameters={}),
        server.calibrating.activate(record.id),
        server.calibrating.activate(None),
        server.change_rig(lambda: replace(server.rig.rig, for_simulated=True)),
    ):
        with pytest.raises(Conflict, match="a calibration is in progress; save or cancel"):
            await refused
    assert names(server) == ["1"]
    assert peer.calibrating is not None
    assert await server.runs.archive.newest() == []


async def test_a_run_is_not_ended_by_calibrating(peer: Any, server: Server) -> None:
    await begin(server)
    with pytest.raises(Conflict, match="is in progress; stop it before you calibrate"):
        await server.calibrating.begin(CAMERAS, BOARD)
    assert begin_requests(peer) == []
    assert server.calibrating.session.facts() is None


async def test_leaving_reopens_the_previous_source(peer: Any, server: Server) -> None:
    await server.source.open("a/folder", None)
    await captured(peer, server)
    await server.calibrating.end()
    assert server.calibrating.session.facts() is None
    assert (peer.opened.source, peer.calibrating) == ("a/folder", None)
    assert server.source.state.state is EngineState.PREVIEW
    # Ending twice does nothing: there is no calibration, so nothing is opened.
    before = len(peer.commands)
    await server.calibrating.end()
    assert len(peer.commands) == before


@pytest.mark.parametrize("refusal", ["input", "state", "failure"])
async def test_leaving_closes_the_cameras_when_the_source_cannot_be_reopened(
    peer: Any, monkeypatch: pytest.MonkeyPatch, refusal: Any, server: Server
) -> None:
    await captured(peer, server)

    def unplugged(_: OpenSource) -> Any:
        raise ProcessRefused("the left camera is not plugged in", refusal)

    monkeypatch.setattr(peer, "_open", unplugged)
    await server.calibrating.end()
    assert isinstance(peer.commands[-1], CloseSource)
    assert peer.calibrating is None
    assert server.source.state.state is EngineState.FAILED
    assert server.source.state.reason == "the left camera is not plugged in"
    assert server.calibrating.session.facts() is None


async def test_leaving_restores_the_failure_of_a_source_that_never_opened(
    peer: Any, storage: Storage
) -> None:
    async with started(peer, storage, "uncalibrated") as server:
        assert server.source.state.state is EngineState.FAILED
        # The source that is open, or should be: this is how a source gets its first calibration.
        await server.calibrating.begin(None, BOARD)
        assert begin_requests(peer)[-1].source == "uncalibrated"
        await server.calibrating.end()
        assert server.source.state.state is EngineState.FAILED
        assert "has no calibration" in str(server.source.state.reason)


async def test_starting_again_replaces_the_first_calibration(peer: Any, server: Server) -> None:
    await captured(peer, server)
    other = Board("charuco", 7, 5, 0.03)
    # The same cameras again, since they are open.
    await server.calibrating.begin(None, other)
    newest = begin_requests(peer)[-1]
    assert newest == BeginCalibration(CAMERAS, other, opening=newest.opening)
    assert names(server) == []
    facts = server.calibrating.session.facts()
    assert facts is not None
    assert facts.board.kind == "charuco"


async def test_a_failed_start_leaves_everything_unchanged(peer: Any, server: Server) -> None:
    with pytest.raises(FieldError, match="name one that exists") as refused:
        await server.calibrating.begin("missing", BOARD)
    assert refused.value.field == ("body", "source")
    assert server.calibrating.session.facts() is None
    assert server.source.state.state is EngineState.PREVIEW
    await captured(peer, server)
    before = server.calibrating.session.facts()
    for source in ("missing", "a\0b", "x" * 1001):
        with pytest.raises(FieldError):
            await server.calibrating.begin(source, BOARD)
    peer.lose()
    with pytest.raises(NotAvailable):
        await server.calibrating.begin(CAMERAS, BOARD)
    assert server.calibrating.session.facts() == before


async def test_engine_losses_far_apart_do_not_count_as_consecutive(
    peer: Any, server: Server
) -> None:
    await captured(peer, server)
    for _ in range(5):
        peer.look()
        peer.lose()
        peer.start_process()
        await until_async(lambda: server.source.state.state is EngineState.CALIBRATING)
    assert names(server) == ["1", "2", "3"]
    peer.look()
    for _ in range(3):
        peer.lose()
        peer.start_process()
        await until_async(lambda: peer.calibrating or "in a row" in str(server.source.state.reason))
    assert server.source.state.state is EngineState.FAILED
    assert f"3 times in a row on {CAMERAS}" in str(server.source.state.reason)
    # The views are still there, and the user can still leave.
    assert names(server) == ["1", "2", "3"]
    await server.calibrating.end()
    assert server.source.state.state is EngineState.PREVIEW


async def test_an_engine_lost_while_answering_is_not_mistaken_for_the_next(
    peer: Any, server: Server
) -> None:
    await captured(peer, server)
    again = [True]

    def replace_engine(event: Event) -> None:
        if isinstance(event, StateEvent) and event.state is EngineState.CALIBRATING and again:
            again.pop()
            loop = asyncio.get_running_loop()
            loop.call_soon(peer.lose)
            loop.call_soon(peer.start_process)

    peer.subscribe(replace_engine)
    peer.lose()
    peer.start_process()
    await until_async(lambda: peer.generation == 3 and peer.calibrating)
    await until_async(lambda: server.source.state.state is EngineState.CALIBRATING)
    assert names(server) == ["1", "2", "3"]


async def test_cameras_lost_with_the_engine_leave_the_views(peer: Any, server: Server) -> None:
    await captured(peer, server)
    server.calibrating.session.source = "missing"
    peer.lose()
    peer.start_process()
    await until_async(lambda: "name one that exists" in str(server.source.state.reason))
    assert server.source.state.state is EngineState.FAILED
    assert names(server) == ["1", "2", "3"]


# --- views ----------------------------------------------------------------------------------


async def test_views_are_captured_undone_and_removed(peer: Any, server: Server) -> None:
    with pytest.raises(Conflict, match="start one first"):
        await server.calibrating.change(CAPTURE)
    await server.calibrating.begin(CAMERAS, BOARD)
    with pytest.raises(Conflict, match="not visible to both cameras"):
        await server.calibrating.change(CAPTURE)
    with pytest.raises(Conflict, match="no view to undo"):
        await server.calibrating.change(ChangeCalibration(undo=True))
    peer.board_seen = True
    for _ in range(3):
        await server.calibrating.change(CAPTURE)
    await server.calibrating.change(ChangeCalibration(remove="2"))
    assert names(server) == ["1", "3"]
    for name in ("2", "", "../1"):
        with pytest.raises(NotThere):
            await server.calibrating.change(ChangeCalibration(remove=name))
        with pytest.raises(NotThere):
            server.calibrating.session.picture(name, 0)
    await server.calibrating.change(ChangeCalibration(undo=True))
    assert names(server) == ["1"]


async def test_the_status_shows_the_board_detection(peer: Any, server: Server) -> None:
    # Looks of a session that is over are ignored.
    peer.look()
    assert status(server).calibrating is None
    await captured(peer, server, 1)
    peer.look(words="Captured 1", coverage={"X": 0.5}, covered="left")
    told = status(server)
    assert told.engine.state == "calibrating"
    facts = told.calibrating
    assert facts.look.words == "Captured 1"
    assert facts.look.covered == "left"
    assert facts.size == (512, 256)
    assert facts.views == [CapturedView("1", 54, 54, True)]
    assert (facts.computing, facts.trouble, facts.result) == (None, None, None)


# --- left and right -------------------------------------------------------------------------


async def test_swapping_cameras_swaps_the_views_and_drops_the_result(
    peer: Any, computing: Computing, server: Server
) -> None:
    with pytest.raises(Conflict, match="start one first"):
        await server.calibrating.swap()
    await server.calibrating.begin("camera:0,2", BOARD)
    both = sighting_of(BOARD)
    other = BoardSighting(both.ids, both.px + 7.0)
    peer.capture(BoardView("1", both, other))
    peer.capture(BoardView("2", both, None))
    computing.release.set()
    server.calibrating.session.compute("radtan")
    await until_async(lambda: server.calibrating.session.computation.result)
    await server.calibrating.swap()
    again = begin_requests(peer)[-1]
    assert (again.source, again.board) == ("camera:2,0", BOARD)
    first, second = again.views
    assert (first.left, first.right) == (other, both)
    assert (second.left, second.right) == (None, both)
    assert names(server) == ["1", "2"]
    # The result was for the cameras the other way round.
    assert server.calibrating.session.computation.result is None
    # After the loss of the engine, they come back swapped.
    peer.lose()
    peer.start_process()
    await until_async(lambda: peer.calibrating)
    assert begin_requests(peer)[-1].source == "camera:2,0"
    assert begin_requests(peer)[-1].views == again.views


async def test_a_failed_swap_changes_nothing(
    peer: Any, monkeypatch: pytest.MonkeyPatch, server: Server
) -> None:
    def unplugged(_: BeginCalibration) -> Any:
        raise ProcessRefused("the left camera is not plugged in", "input")

    await captured(peer, server)
    with pytest.raises(Conflict):
        await server.calibrating.swap()
    await server.calibrating.begin("camera:0,2", BOARD)
    await server.calibrating.change(CAPTURE)
    before = server.calibrating.session.facts()
    monkeypatch.setattr(peer, "_begin", unplugged)
    with pytest.raises(FieldError, match="not plugged in"):
        await server.calibrating.swap()
    assert server.calibrating.session.source == "camera:0,2"
    assert server.calibrating.session.facts() == before
