"""Calibrating over a peer engine: views outlive engines, nothing is lost, nothing stays open."""

from __future__ import annotations

import asyncio
import sqlite3
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from app.calibration_worker.messages import BoardsFound, FindBoards, Fitted, FitViews, Progress
from app.messages import BeginCalibration, ChangeCalibration, CloseSource, EngineState, OpenSource
from app.station import Conflict, FieldError, NotAvailable, NotThere, Station, calibration_desk
from app.station.status import status
from app.storage import Storage, StorageBusy, StorageFull
from app.supervisor import EngineRefused
from observer.calibration.board import Board
from observer.calibration.formats.opencv_file import calibration_id
from observer.calibration.views import BoardSighting, BoardView
from observer.errors import CalibrationError

BOARD = Board("chessboard", 9, 6, 0.025)
CAMERAS = "simulated:calibration"
CAPTURE = ChangeCalibration(capture=True)


@asynccontextmanager
async def started(
    peer: Any, storage: Storage, source: str = "simulated:lab"
) -> AsyncIterator[Station]:
    station = Station(peer, storage, source=source)
    try:
        await station.start()
        await until(lambda: station.state.state is not EngineState.IDLE)
        yield station
    finally:
        await station.stop()


def run(scenario: Coroutine[Any, Any, None]) -> None:
    async def limited() -> None:
        async with asyncio.timeout(60):
            await scenario

    asyncio.run(limited())


async def until(condition: Callable[[], Any]) -> None:
    async with asyncio.timeout(20):
        while not condition():
            await asyncio.sleep(0.005)


async def captured(peer: Any, station: Station, count: int = 3) -> None:
    """Calibrate the cameras, with so many views already taken."""
    await station.begin_calibration(CAMERAS, BOARD)
    peer.board_seen = True
    for _ in range(count):
        await station.change_calibration(CAPTURE)


def sighting_of(board: Board) -> BoardSighting:
    """All corners of a board, somewhere in an image."""
    px = board.object_points[:, :2] / board.square_m * 20.0 + 50.0
    return BoardSighting(np.arange(len(px), dtype=np.int32), px)


def names(station: Station) -> list[str]:
    facts = station.calibrating.facts()
    assert facts is not None
    return [view["name"] for view in facts["views"]]


def begun(peer: Any) -> list[BeginCalibration]:
    return [command for command in peer.commands if isinstance(command, BeginCalibration)]


def opens(peer: Any) -> list[OpenSource]:
    return [command for command in peer.commands if isinstance(command, OpenSource)]


class Computing:
    """Stands for the worker: hears what it is asked, and answers when it is told to."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.jobs: list[Any] = []
        self.release = asyncio.Event()
        self.fails: Exception | None = None
        self.cancelled = 0

    async def __call__(self, job: Any, progress: Callable[[Progress], None]) -> Any:
        self.jobs.append(job)
        progress(Progress("fitting both cameras", 0.5))
        try:
            await self.release.wait()
        except asyncio.CancelledError:
            self.cancelled += 1
            raise
        if self.fails is not None:
            raise self.fails
        if isinstance(job, FitViews):
            return Fitted(self.text, {"stereo_rms_px": 0.2})
        view = BoardView("a", None, None)
        return BoardsFound((view,), ((b"left", b"right"),), 640, 480, ("b: blurred",))


@pytest.fixture
def computing(monkeypatch: pytest.MonkeyPatch, calibration_yaml: Any) -> Computing:
    made = Computing(calibration_yaml())
    monkeypatch.setattr(calibration_desk, "work", made)
    return made


async def computed(peer: Any, station: Station, computing: Computing) -> None:
    """Calibrate the cameras and have a result."""
    await captured(peer, station)
    computing.release.set()
    station.calibrating.compute("radtan")
    await until(lambda: station.calibrating.result)


@contextmanager
def locked(path: Path) -> Iterator[None]:
    lock = sqlite3.connect(path, isolation_level=None)
    lock.execute("BEGIN IMMEDIATE")
    try:
        yield
    finally:
        lock.execute("ROLLBACK")
        lock.close()


# --- beginning and leaving ------------------------------------------------------------------


def test_views_outlive_the_engine_and_the_numbering_goes_on(peer: Any, storage: Storage) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as station:
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

    run(scenario())


def test_other_work_is_refused_while_calibrating(
    peer: Any, storage: Storage, calibration_yaml: Any
) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as station:
            record = storage.save_calibration(calibration_yaml(), name="x", info={})
            await captured(peer, station, 1)
            none: dict[str, Any] = {"name": None, "source": None, "calibration_id": None}
            for refused in (
                station.open_source("a/folder", None),
                station.start_run(**none, preset=None, parameters={}),
                station.activate_calibration(record.id),
                station.activate_calibration(None),
                station.keep_rig(replace(station.rig.rig, for_simulated=True)),
            ):
                with pytest.raises(Conflict, match="a calibration is being made; save it or leave"):
                    await refused
            assert names(station) == ["1"]
            assert peer.calibrating is not None
            assert await station.runs.newest() == []

    run(scenario())


def test_a_run_is_not_ended_by_calibrating(peer: Any, storage: Storage) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as station:
            await station.start_run(
                name=None, source=None, calibration_id=None, preset=None, parameters={}
            )
            with pytest.raises(Conflict, match="is going; stop it before you calibrate"):
                await station.begin_calibration(CAMERAS, BOARD)
            assert begun(peer) == []
            assert station.calibrating.facts() is None

    run(scenario())


def test_leaving_observes_again_what_was_open(peer: Any, storage: Storage) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as station:
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

    run(scenario())


@pytest.mark.parametrize("refusal", ["input", "state", "failure"])
def test_leaving_closes_the_cameras_where_nothing_can_be_opened(
    peer: Any, storage: Storage, monkeypatch: pytest.MonkeyPatch, refusal: Any
) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as station:
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

    run(scenario())


def test_leaving_a_source_that_never_opened(peer: Any, storage: Storage) -> None:
    async def scenario() -> None:
        async with started(peer, storage, "uncalibrated") as station:
            assert station.state.state is EngineState.FAILED
            # What is open, or was meant to be: this is how a source gets its first calibration.
            await station.begin_calibration(None, BOARD)
            assert begun(peer)[-1].source == "uncalibrated"
            await station.end_calibration()
            assert station.state.state is EngineState.FAILED
            assert "brings no calibration" in str(station.state.reason)

    run(scenario())


def test_a_second_begin_replaces_the_first(peer: Any, storage: Storage) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as station:
            await captured(peer, station)
            other = Board("charuco", 7, 5, 0.03)
            # The same cameras again: they are what is open.
            await station.begin_calibration(None, other)
            assert begun(peer)[-1] == BeginCalibration(CAMERAS, other)
            assert names(station) == []
            facts = station.calibrating.facts()
            assert facts is not None
            assert facts["board"]["kind"] == "charuco"

    run(scenario())


def test_a_begin_that_fails_leaves_everything_as_it_was(peer: Any, storage: Storage) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as station:
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

    run(scenario())


def test_engines_lost_hours_apart_are_not_three_in_a_row(peer: Any, storage: Storage) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as station:
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
                await until(
                    lambda: peer.calibrating or "in a row" in str(station.state.reason)
                )
            assert station.state.state is EngineState.FAILED
            assert f"3 times in a row over {CAMERAS}" in str(station.state.reason)
            # The views are there still, and so is the way out.
            assert names(station) == ["1", "2", "3"]
            await station.end_calibration()
            assert station.state.state is EngineState.PREVIEW

    run(scenario())


def test_cameras_that_are_gone_with_the_engine_leave_the_views(peer: Any, storage: Storage) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as station:
            await captured(peer, station)
            station.calibrating.source = "missing"
            peer.lose()
            peer.start_process()
            await until(lambda: "name one that exists" in str(station.state.reason))
            assert station.state.state is EngineState.FAILED
            assert names(station) == ["1", "2", "3"]

    run(scenario())


# --- views ----------------------------------------------------------------------------------


def test_views_are_captured_taken_back_and_removed(peer: Any, storage: Storage) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as station:
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

    run(scenario())


def test_what_is_seen_is_in_the_status(peer: Any, storage: Storage) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as station:
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

    run(scenario())


# --- computing ------------------------------------------------------------------------------


def test_a_computation_is_going_from_the_moment_it_is_asked_for(
    peer: Any, storage: Storage, computing: Computing
) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as station:
            desk = station.calibrating
            with pytest.raises(Conflict, match="begin a calibration first"):
                desk.compute("radtan")
            await captured(peer, station, 0)
            with pytest.raises(Conflict, match="no views yet"):
                desk.compute("radtan")
            with pytest.raises(Conflict, match="nothing has been computed yet"):
                _ = desk.finished
            await captured(peer, station)
            desk.compute("equidistant")
            with pytest.raises(Conflict, match="being computed; wait for it, or cancel"):
                desk.compute("radtan")
            with pytest.raises(Conflict, match="being computed"):
                await station.calibrate_images(FindBoards(Path("/nowhere"), BOARD))
            await until(lambda: (desk.facts() or {})["computing"]["share"] == 0.5)
            (job,) = computing.jobs
            assert (job.width, job.height, job.frame_rate) == (512, 256, 15.0)
            assert job.distortion_model == "equidistant"
            computing.release.set()
            await until(lambda: desk.result)
            facts = desk.facts()
            assert facts is not None
            assert (facts["computing"], facts["result"]) == (None, ["1", "2", "3"])

    run(scenario())


def test_cancelling_leaves_views_and_the_earlier_result(
    peer: Any, storage: Storage, computing: Computing
) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as station:
            await computed(peer, station, computing)
            desk = station.calibrating
            computing.release.clear()
            for pause in (0.0, 0.05):
                desk.compute("radtan")
                await asyncio.sleep(pause)
                await desk.cancel()
                facts = desk.facts()
                assert facts is not None
                assert (facts["computing"], facts["trouble"]) == (None, None)
                assert facts["result"] == ["1", "2", "3"]
            assert names(station) == ["1", "2", "3"]
            assert computing.cancelled == 2
            await desk.cancel()

    run(scenario())


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (CalibrationError("the views are too much alike"), "the views are too much alike"),
        (ZeroDivisionError("by zero"), "computing failed: ZeroDivisionError: by zero"),
    ],
)
def test_a_computation_that_fails_says_why_until_the_next(
    peer: Any, storage: Storage, computing: Computing, error: Exception, words: str
) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as station:
            await captured(peer, station)
            desk = station.calibrating
            computing.fails = error
            computing.release.set()
            desk.compute("radtan")
            await until(lambda: (desk.facts() or {})["trouble"])
            facts = desk.facts()
            assert facts is not None
            assert (facts["trouble"], facts["computing"]) == (words, None)
            assert names(station) == ["1", "2", "3"]
            computing.fails = None
            desk.compute("radtan")
            assert (desk.facts() or {})["trouble"] is None
            await until(lambda: desk.result)

    run(scenario())


def test_leaving_and_stopping_end_the_worker(peer: Any, storage: Storage) -> None:
    """With the real worker, which takes a second to begin: it never comes to its end."""

    async def scenario() -> None:
        async with started(peer, storage) as station:
            await captured(peer, station)
            station.calibrating.compute("radtan")
            await until(workers)
            await station.end_calibration()
            assert workers() == []
            await captured(peer, station)
            station.calibrating.compute("radtan")
            await until(workers)
        assert workers() == []

    run(scenario())


def workers() -> list[psutil.Process]:
    found = []
    for child in psutil.Process().children():
        try:
            if child.status() != psutil.STATUS_ZOMBIE and "app.calibration_worker" in (
                child.cmdline()
            ):
                found.append(child)
        except psutil.NoSuchProcess:
            continue
    return found


# --- images sent in -------------------------------------------------------------------------


def test_images_take_the_place_of_the_cameras(
    peer: Any, storage: Storage, computing: Computing
) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as station:
            await captured(peer, station)
            computing.fails = CalibrationError("the file is no ZIP archive")
            computing.release.set()
            job = FindBoards(Path("/nowhere"), BOARD)
            with pytest.raises(CalibrationError, match="no ZIP archive"):
                await station.calibrate_images(job)
            assert names(station) == ["1", "2", "3"]
            assert peer.calibrating is not None

            computing.fails = None
            await station.calibrate_images(job)
            assert names(station) == ["a"]
            facts = station.calibrating.facts()
            assert facts is not None
            assert (facts["source"], facts["refused"]) == (None, ["b: blurred"])
            assert facts["size"] == (640, 480)
            # The cameras are observed again, and lost engines have nothing to go on with.
            assert station.state.state is EngineState.PREVIEW
            peer.lose()
            peer.start_process()
            await until(lambda: station.state.state is EngineState.PREVIEW)
            assert names(station) == ["a"]
            with pytest.raises(Conflict, match="images were sent in"):
                await station.change_calibration(CAPTURE)
            with pytest.raises(NotThere):
                await station.change_calibration(ChangeCalibration(remove="b"))
            await station.change_calibration(ChangeCalibration(remove="a"))
            assert names(station) == []

    run(scenario())


def test_looking_through_images_holds_nothing_up_and_can_be_cancelled(
    peer: Any, storage: Storage, computing: Computing
) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as station:
            job = FindBoards(Path("/nowhere"), BOARD)
            looking = asyncio.create_task(station.calibrate_images(job))
            await until(lambda: computing.jobs)
            # A lost engine is restored, another source opened: minutes are not waited for.
            peer.lose()
            peer.start_process()
            await until(lambda: station.state.state is EngineState.PREVIEW)
            await station.open_source("a/folder", None)
            await station.calibrating.cancel()
            with pytest.raises(Conflict, match="was cancelled"):
                await looking
            assert station.calibrating.facts() is None
            assert computing.cancelled == 1

    run(scenario())


# --- saving ---------------------------------------------------------------------------------


def test_what_is_saved_is_used_and_the_desk_is_cleared(
    peer: Any, storage: Storage, computing: Computing
) -> None:
    peer.devices = ("usb-0000:00:14.0-1", "usb-0000:00:14.0-2")

    async def scenario() -> None:
        async with started(peer, storage) as station:
            await computed(peer, station, computing)
            record = await station.save_calibration("Bench", activate=True)
            assert record.id == calibration_id(computing.text)
            assert (peer.opened.source, peer.opened.calibration_yaml) == (CAMERAS, computing.text)
            assert station.calibrating.facts() is None
            assert (station.wanted.source, station.wanted.calibration) == (CAMERAS, record)
            assert record.info["report"] == {"stereo_rms_px": 0.2}
            assert record.info["bound"]["source"] == CAMERAS
            assert record.info["bound"]["devices"] == list(peer.devices)
            await until(lambda: storage.active_calibration() == record)

    run(scenario())


def test_saving_only_leaves_the_desk(peer: Any, storage: Storage, computing: Computing) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as station:
            await captured(peer, station)
            with pytest.raises(Conflict, match="nothing has been computed yet"):
                await station.save_calibration("Bench", activate=False)
            assert storage.list_calibrations() == []
            await computed(peer, station, computing)
            await station.save_calibration("Bench", activate=False)
            assert peer.calibrating is not None
            assert station.calibrating.result is not None
            assert names(station) == ["1", "2", "3"]
            assert storage.active_calibration() is None

    run(scenario())


def test_a_full_disk_or_a_busy_database_loses_nothing(
    peer: Any,
    storage: Storage,
    computing: Computing,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def full(*_: Any, **__: Any) -> Any:
        raise StorageFull("no space is left")

    async def scenario() -> None:
        async with started(peer, storage) as station:
            await computed(peer, station, computing)
            await until(lambda: station.writer.trouble is None)
            before = station.calibrating.facts()
            with locked(tmp_path / "observer.sqlite"), pytest.raises(StorageBusy):
                await station.save_calibration("Bench", activate=True)
            with monkeypatch.context() as patch:
                patch.setattr(storage, "save_calibration", full)
                with pytest.raises(StorageFull):
                    await station.save_calibration("Bench", activate=True)
            assert station.calibrating.facts() == before
            assert station.calibrating.result is not None
            assert peer.calibrating is not None
            await station.save_calibration("Bench", activate=True)
            assert peer.opened.calibration_yaml == computing.text

    run(scenario())


@pytest.mark.parametrize(("refusal", "kind"), [("input", FieldError), ("failure", NotAvailable)])
def test_what_cannot_be_used_is_saved_all_the_same(
    peer: Any,
    storage: Storage,
    computing: Computing,
    monkeypatch: pytest.MonkeyPatch,
    refusal: Any,
    kind: type[Exception],
) -> None:
    def other_size(_: OpenSource) -> Any:
        raise EngineRefused("the calibration is for images of 640x480 pixels", refusal)

    async def scenario() -> None:
        async with started(peer, storage) as station:
            await computed(peer, station, computing)
            with monkeypatch.context() as patch:
                patch.setattr(peer, "_open", other_size)
                with pytest.raises(kind, match=r"Bench is saved, but not in use: .* 640x480"):
                    await station.save_calibration("Bench", activate=True)
            assert [record.name for record in storage.list_calibrations()] == ["Bench"]
            assert names(station) == ["1", "2", "3"]
            assert station.wanted.source == "simulated:lab"
            assert storage.active_calibration() is None

    run(scenario())


def test_saving_again_keeps_what_was_measured(
    peer: Any, storage: Storage, computing: Computing
) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as station:
            await computed(peer, station, computing)
            first = await station.save_calibration("Bench", activate=False)
            checks = [{"measured_m": 2.0}]
            storage.change_calibration(first.id, info={"tape_checks": checks})
            second = await station.save_calibration("Bench 2", activate=False)
            assert (second.id, second.name) == (first.id, "Bench 2")
            assert second.info["tape_checks"] == checks
            assert second.info["report"] == {"stereo_rms_px": 0.2}

    run(scenario())


def test_a_new_name_is_told_everywhere(
    peer: Any, storage: Storage, computing: Computing
) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as station:
            await computed(peer, station, computing)
            record = await station.save_calibration("Bench", activate=True)
            before = len(opens(peer))
            renamed = await station.rename_calibration(record.id, "Robot 3")
            assert status(station)["calibration"] == {"id": record.id, "name": "Robot 3"}
            await station.activate_calibration(record.id)
            assert len(opens(peer)) == before
            with pytest.raises(Conflict, match="Robot 3 is in use"):
                await station.delete_calibration(record.id)
            assert storage.get_calibration(record.id) == renamed
            with pytest.raises(NotThere):
                await station.rename_calibration("0" * 64, "x")

    run(scenario())


# --- left and right -------------------------------------------------------------------------


def test_swapping_turns_the_views_round_and_forgets_the_result(
    peer: Any, storage: Storage, computing: Computing
) -> None:
    async def scenario() -> None:
        async with started(peer, storage) as station:
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

    run(scenario())


def test_what_cannot_be_swapped_stays_as_it_is(
    peer: Any, storage: Storage, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unplugged(_: BeginCalibration) -> Any:
        raise EngineRefused("the left camera is not plugged in", "input")

    async def scenario() -> None:
        async with started(peer, storage) as station:
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

    run(scenario())
