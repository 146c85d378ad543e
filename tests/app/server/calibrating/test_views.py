"""Calibrating over a peer engine: views outlive engines, nothing stays open."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from app.messages import BeginCalibration, ChangeCalibration, CloseSource, EngineState, OpenSource
from app.server import Conflict, FieldError, NotAvailable, NotThere, Station
from app.server.status import status
from app.storage import Storage
from app.supervisor import EngineRefused
from observer.calibration.board import Board
from observer.calibration.views import BoardSighting, BoardView

from ...peer_engine import sighting_of
from ..servers import begin, opens, started, until
from .desk import (
    BOARD,
    CAMERAS,
    CAPTURE,
    Computing,
    begun,
    captured,
    names,
)

# --- beginning and leaving ------------------------------------------------------------------


async def test_views_outlive_the_engine_and_the_numbering_goes_on(
    peer: Any, station: Station
) -> None:
    await captured(peer, station)
    await station.change_calibration(ChangeCalibration(undo=True))
    await station.change_calibration(ChangeCalibration(automatic=False))
    peer.lose("the engine was killed")
    assert station.state.state is EngineState.FAILED
    assert names(station) == ["1", "2"]
    peer.start_process()
    await until(lambda: station.state.state is EngineState.CALIBRATING)
    again = begun(peer)[-1]
    assert (again.source, again.board, again.automatic) == (CAMERAS, BOARD, False)
    assert [view.name for view in again.views] == ["1", "2"]
    await station.change_calibration(CAPTURE)
    assert names(station) == ["1", "2", "3"]
    assert station.calibrating.picture("1", 0).startswith(b"\xff\xd8")
    # Nothing else was opened behind the calibration's back.
    assert len(opens(peer)) == 1


async def test_other_work_is_refused_while_calibrating(
    peer: Any, storage: Storage, calibration_yaml: Any, station: Station
) -> None:
    record = storage.save_calibration(calibration_yaml(), name="x", info={})
    await captured(peer, station, 1)
    none: dict[str, Any] = {"name": None, "source": None, "calibration_id": None}
    for refused in (
        station.open_source("a/folder", None),
        station.start_run(**none, preset=None, parameters={}),
        station.activate_calibration(record.id),
        station.activate_calibration(None),
        station.change_rig(lambda: replace(station.rig.rig, for_simulated=True)),
    ):
        with pytest.raises(Conflict, match="a calibration is being made; save it or leave"):
            await refused
    assert names(station) == ["1"]
    assert peer.calibrating is not None
    assert await station.runs.newest() == []


async def test_a_run_is_not_ended_by_calibrating(peer: Any, station: Station) -> None:
    await begin(station)
    with pytest.raises(Conflict, match="is going; stop it before you calibrate"):
        await station.begin_calibration(CAMERAS, BOARD)
    assert begun(peer) == []
    assert station.calibrating.facts() is None


async def test_leaving_observes_again_what_was_open(peer: Any, station: Station) -> None:
    await station.open_source("a/folder", None)
    await captured(peer, station)
    await station.end_calibration()
    assert station.calibrating.facts() is None
    assert (peer.opened.source, peer.calibrating) == ("a/folder", None)
    assert station.state.state is EngineState.PREVIEW
    # And again: nothing is calibrated, so nothing is opened.
    before = len(peer.commands)
    await station.end_calibration()
    assert len(peer.commands) == before


@pytest.mark.parametrize("refusal", ["input", "state", "failure"])
async def test_leaving_closes_the_cameras_where_nothing_can_be_opened(
    peer: Any, monkeypatch: pytest.MonkeyPatch, refusal: Any, station: Station
) -> None:
    await captured(peer, station)

    def unplugged(_: OpenSource) -> Any:
        raise EngineRefused("the left camera is not plugged in", refusal)

    monkeypatch.setattr(peer, "_open", unplugged)
    await station.end_calibration()
    assert isinstance(peer.commands[-1], CloseSource)
    assert peer.calibrating is None
    assert station.state.state is EngineState.FAILED
    assert station.state.reason == "the left camera is not plugged in"
    assert station.calibrating.facts() is None


async def test_leaving_a_source_that_never_opened(peer: Any, storage: Storage) -> None:
    async with started(peer, storage, "uncalibrated") as station:
        assert station.state.state is EngineState.FAILED
        # What is open, or was meant to be: this is how a source gets its first calibration.
        await station.begin_calibration(None, BOARD)
        assert begun(peer)[-1].source == "uncalibrated"
        await station.end_calibration()
        assert station.state.state is EngineState.FAILED
        assert "brings no calibration" in str(station.state.reason)


async def test_a_second_begin_replaces_the_first(peer: Any, station: Station) -> None:
    await captured(peer, station)
    other = Board("charuco", 7, 5, 0.03)
    # The same cameras again: they are what is open.
    await station.begin_calibration(None, other)
    assert begun(peer)[-1] == BeginCalibration(CAMERAS, other)
    assert names(station) == []
    facts = station.calibrating.facts()
    assert facts is not None
    assert facts["board"]["kind"] == "charuco"


async def test_a_begin_that_fails_leaves_everything_as_it_was(peer: Any, station: Station) -> None:
    with pytest.raises(FieldError, match="name one that exists") as refused:
        await station.begin_calibration("missing", BOARD)
    assert refused.value.field == ("body", "source")
    assert station.calibrating.facts() is None
    assert station.state.state is EngineState.PREVIEW
    await captured(peer, station)
    before = station.calibrating.facts()
    for source in ("missing", "a\0b", "x" * 1001):
        with pytest.raises(FieldError):
            await station.begin_calibration(source, BOARD)
    peer.lose()
    with pytest.raises(NotAvailable):
        await station.begin_calibration(CAMERAS, BOARD)
    assert station.calibrating.facts() == before


async def test_engines_lost_hours_apart_are_not_three_in_a_row(peer: Any, station: Station) -> None:
    await captured(peer, station)
    for _ in range(5):
        peer.look()
        peer.lose()
        peer.start_process()
        await until(lambda: station.state.state is EngineState.CALIBRATING)
    assert names(station) == ["1", "2", "3"]
    peer.look()
    for _ in range(3):
        peer.lose()
        peer.start_process()
        await until(lambda: peer.calibrating or "in a row" in str(station.state.reason))
    assert station.state.state is EngineState.FAILED
    assert f"3 times in a row over {CAMERAS}" in str(station.state.reason)
    # The views are there still, and so is the way out.
    assert names(station) == ["1", "2", "3"]
    await station.end_calibration()
    assert station.state.state is EngineState.PREVIEW


async def test_cameras_that_are_gone_with_the_engine_leave_the_views(
    peer: Any, station: Station
) -> None:
    await captured(peer, station)
    station.calibrating.source = "missing"
    peer.lose()
    peer.start_process()
    await until(lambda: "name one that exists" in str(station.state.reason))
    assert station.state.state is EngineState.FAILED
    assert names(station) == ["1", "2", "3"]


# --- views ----------------------------------------------------------------------------------


async def test_views_are_captured_taken_back_and_removed(peer: Any, station: Station) -> None:
    with pytest.raises(Conflict, match="begin a calibration first"):
        await station.change_calibration(CAPTURE)
    await station.begin_calibration(CAMERAS, BOARD)
    with pytest.raises(Conflict, match="not in both views"):
        await station.change_calibration(CAPTURE)
    with pytest.raises(Conflict, match="no view to take back"):
        await station.change_calibration(ChangeCalibration(undo=True))
    peer.board_seen = True
    for _ in range(3):
        await station.change_calibration(CAPTURE)
    await station.change_calibration(ChangeCalibration(remove="2"))
    assert names(station) == ["1", "3"]
    for name in ("2", "", "../1"):
        with pytest.raises(NotThere):
            await station.change_calibration(ChangeCalibration(remove=name))
        with pytest.raises(NotThere):
            station.calibrating.picture(name, 0)
    await station.change_calibration(ChangeCalibration(undo=True))
    assert names(station) == ["1"]


async def test_what_is_seen_is_in_the_status(peer: Any, station: Station) -> None:
    # Of a session that is over: nobody is told.
    peer.look()
    assert status(station)["calibrating"] is None
    await captured(peer, station, 1)
    peer.look(words="Captured 1", coverage={"X": 0.5}, covered="left")
    told = status(station)
    assert told["engine"]["state"] == "calibrating"
    facts = told["calibrating"]
    assert facts["look"]["words"] == "Captured 1"
    assert facts["look"]["covered"] == "left"
    assert facts["size"] == (512, 256)
    assert facts["views"] == [{"name": "1", "left": 54, "right": 54, "picture": True}]
    assert (facts["computing"], facts["trouble"], facts["result"]) == (None, None, None)


# --- left and right -------------------------------------------------------------------------


async def test_swapping_turns_the_views_round_and_forgets_the_result(
    peer: Any, computing: Computing, station: Station
) -> None:
    with pytest.raises(Conflict, match="begin a calibration first"):
        await station.swap_cameras()
    await station.begin_calibration("camera:0,2", BOARD)
    both = sighting_of(BOARD)
    other = BoardSighting(both.ids, both.px + 7.0)
    peer.capture(BoardView("1", both, other))
    peer.capture(BoardView("2", both, None))
    computing.release.set()
    station.calibrating.compute("radtan")
    await until(lambda: station.calibrating.result)
    await station.swap_cameras()
    again = begun(peer)[-1]
    assert (again.source, again.board) == ("camera:2,0", BOARD)
    first, second = again.views
    assert (first.left, first.right) == (other, both)
    assert (second.left, second.right) == (None, both)
    assert names(station) == ["1", "2"]
    # What was computed was of cameras the other way round.
    assert station.calibrating.result is None
    # Gone with the engine, they come back swapped.
    peer.lose()
    peer.start_process()
    await until(lambda: peer.calibrating)
    assert begun(peer)[-1].source == "camera:2,0"
    assert begun(peer)[-1].views == again.views


async def test_what_cannot_be_swapped_stays_as_it_is(
    peer: Any, monkeypatch: pytest.MonkeyPatch, station: Station
) -> None:
    def unplugged(_: BeginCalibration) -> Any:
        raise EngineRefused("the left camera is not plugged in", "input")

    await captured(peer, station)
    with pytest.raises(Conflict):
        await station.swap_cameras()
    await station.begin_calibration("camera:0,2", BOARD)
    await station.change_calibration(CAPTURE)
    before = station.calibrating.facts()
    monkeypatch.setattr(peer, "_begin", unplugged)
    with pytest.raises(FieldError, match="not plugged in"):
        await station.swap_cameras()
    assert station.calibrating.source == "camera:0,2"
    assert station.calibrating.facts() == before
