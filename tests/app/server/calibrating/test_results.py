"""Computing and saving a calibration over a peer engine: nothing is lost."""

from __future__ import annotations

import asyncio
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil
import pytest

from app.contract.commands import ChangeCalibration, OpenSource
from app.contract.events import EngineState
from app.contract.status import CalibrationReference
from app.runtime.errors import ProcessRefused
from app.server import Conflict, FieldError, NotAvailable, NotThere, Server
from app.server.status import status
from app.storage import Storage, StorageBusy, StorageFull
from observer.calibration.formats.opencv_file import calibration_id
from observer.errors import CalibrationError

from ....waiting import until_async
from ..servers import opens, started
from .capturing import (
    BOARD,
    CAMERAS,
    CAPTURE,
    Computing,
    captured,
    computed,
    names,
)


@contextmanager
def locked(path: Path) -> Iterator[None]:
    lock = sqlite3.connect(path, isolation_level=None)
    lock.execute("BEGIN IMMEDIATE")
    try:
        yield
    finally:
        lock.execute("ROLLBACK")
        lock.close()


# --- computing ------------------------------------------------------------------------------


async def test_a_computation_is_in_progress_as_soon_as_it_is_requested(
    peer: Any, computing: Computing, server: Server
) -> None:
    session = server.calibrating.session
    with pytest.raises(Conflict, match="start one first"):
        session.compute("radtan")
    await captured(peer, server, 0)
    with pytest.raises(Conflict, match="no views yet"):
        session.compute("radtan")
    with pytest.raises(Conflict, match="nothing has been computed yet"):
        _ = session.computation.finished
    await captured(peer, server)
    session.compute("equidistant")
    with pytest.raises(Conflict, match="being computed; wait for it, or cancel"):
        session.compute("radtan")
    with pytest.raises(Conflict, match="being computed"):
        await server.calibrating.take_images(Path("/nowhere"), BOARD)
    await until_async(lambda: session.facts().computing.share == 0.5)
    (job,) = computing.jobs
    assert (job.width, job.height, job.frame_rate) == (512, 256, 15.0)
    assert job.distortion_model == "equidistant"
    computing.release.set()
    await until_async(lambda: session.computation.result)
    facts = session.facts()
    assert facts is not None
    assert (facts.computing, facts.result) == (None, ["1", "2", "3"])


async def test_cancelling_keeps_views_and_the_earlier_result(
    peer: Any, computing: Computing, server: Server
) -> None:
    await computed(peer, server, computing)
    session = server.calibrating.session
    computing.release.clear()
    for pause in (0.0, 0.05):
        session.compute("radtan")
        await asyncio.sleep(pause)
        await session.computation.cancel()
        facts = session.facts()
        assert facts is not None
        assert (facts.computing, facts.trouble) == (None, None)
        assert facts.result == ["1", "2", "3"]
    assert names(server) == ["1", "2", "3"]
    assert computing.cancelled == 2
    await session.computation.cancel()


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (CalibrationError("the views are too much alike"), "the views are too much alike"),
        (
            ZeroDivisionError("by zero"),
            "the computation failed: internal error (ZeroDivisionError: by zero); "
            "see the server's log",
        ),
    ],
)
async def test_a_failed_computation_shows_its_reason_until_the_next(
    peer: Any, computing: Computing, error: Exception, words: str, server: Server
) -> None:
    await captured(peer, server)
    session = server.calibrating.session
    computing.fails = error
    computing.release.set()
    session.compute("radtan")
    await until_async(lambda: session.facts().trouble)
    facts = session.facts()
    assert facts is not None
    assert (facts.trouble, facts.computing) == (words, None)
    assert names(server) == ["1", "2", "3"]
    computing.fails = None
    session.compute("radtan")
    assert session.facts().trouble is None
    await until_async(lambda: session.computation.result)


async def test_leaving_and_stopping_end_the_worker(peer: Any, storage: Storage) -> None:
    """With the real worker, which takes a second to start and so never finishes."""

    async with started(peer, storage) as server:
        await captured(peer, server)
        server.calibrating.session.compute("radtan")
        await until_async(workers)
        await server.calibrating.end()
        assert workers() == []
        await captured(peer, server)
        server.calibrating.session.compute("radtan")
        await until_async(workers)
    assert workers() == []


def workers() -> list[psutil.Process]:
    found = []
    for child in psutil.Process().children():
        try:
            if child.status() != psutil.STATUS_ZOMBIE and "app.workers.calibration" in (
                child.cmdline()
            ):
                found.append(child)
        except psutil.NoSuchProcess:
            continue
    return found


# --- images sent in -------------------------------------------------------------------------


async def test_images_replace_the_cameras(peer: Any, computing: Computing, server: Server) -> None:
    await captured(peer, server)
    computing.fails = CalibrationError("the file is not a ZIP archive")
    computing.release.set()
    images = Path("/nowhere")
    with pytest.raises(CalibrationError, match="not a ZIP archive"):
        await server.calibrating.take_images(images, BOARD)
    assert names(server) == ["1", "2", "3"]
    assert peer.calibrating is not None

    computing.fails = None
    await server.calibrating.take_images(images, BOARD)
    assert names(server) == ["a"]
    facts = server.calibrating.session.facts()
    assert facts is not None
    assert (facts.source, facts.refused) == (None, ["b: blurred"])
    assert facts.size == (640, 480)
    # The cameras are observed again; a lost engine has no calibration to resume.
    assert server.source.state.state is EngineState.PREVIEW
    peer.lose()
    peer.start_process()
    await until_async(lambda: server.source.state.state is EngineState.PREVIEW)
    assert names(server) == ["a"]
    with pytest.raises(Conflict, match="uses uploaded images"):
        await server.calibrating.change(CAPTURE)
    with pytest.raises(NotThere):
        await server.calibrating.change(ChangeCalibration(remove="b"))
    await server.calibrating.change(ChangeCalibration(remove="a"))
    assert names(server) == []


async def test_searching_images_blocks_nothing_and_can_be_cancelled(
    peer: Any, computing: Computing, server: Server
) -> None:
    images = Path("/nowhere")
    looking = asyncio.create_task(server.calibrating.take_images(images, BOARD))
    await until_async(lambda: computing.jobs)
    # Restoring a lost engine and opening another source do not wait minutes for the job.
    peer.lose()
    peer.start_process()
    await until_async(lambda: server.source.state.state is EngineState.PREVIEW)
    await server.source.open("a/folder", None)
    await server.calibrating.session.computation.cancel()
    with pytest.raises(Conflict, match="was cancelled"):
        await looking
    assert server.calibrating.session.facts() is None
    assert computing.cancelled == 1


# --- saving ---------------------------------------------------------------------------------


async def test_a_saved_calibration_is_used_and_the_session_cleared(
    peer: Any, storage: Storage, computing: Computing
) -> None:
    peer.devices = ("usb-0000:00:14.0-1", "usb-0000:00:14.0-2")

    async with started(peer, storage) as server:
        await computed(peer, server, computing)
        record = await server.calibrating.save("Bench", activate=True)
        assert record.id == calibration_id(computing.text)
        assert (peer.opened.source, peer.opened.calibration_yaml) == (CAMERAS, computing.text)
        assert server.calibrating.session.facts() is None
        assert (server.source.wanted.source, server.source.wanted.calibration) == (CAMERAS, record)
        assert record.info["report"] == {"stereo_rms_px": 0.2}
        assert record.info["bound"]["source"] == CAMERAS
        assert record.info["bound"]["devices"] == list(peer.devices)
        await until_async(lambda: storage.active_calibration() == record)


async def test_saving_without_activating_keeps_the_session(
    peer: Any, storage: Storage, computing: Computing, server: Server
) -> None:
    await captured(peer, server)
    with pytest.raises(Conflict, match="nothing has been computed yet"):
        await server.calibrating.save("Bench", activate=False)
    assert storage.list_calibrations() == []
    await computed(peer, server, computing)
    await server.calibrating.save("Bench", activate=False)
    assert peer.calibrating is not None
    assert server.calibrating.session.computation.result is not None
    assert names(server) == ["1", "2", "3"]
    assert storage.active_calibration() is None


async def test_a_full_disk_or_a_busy_database_loses_nothing(
    peer: Any,
    storage: Storage,
    computing: Computing,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    server: Server,
) -> None:
    def full(*_: Any, **__: Any) -> Any:
        raise StorageFull("no space is left")

    await computed(peer, server, computing)
    await until_async(lambda: server.shared.writer.trouble is None)
    before = server.calibrating.session.facts()
    with locked(tmp_path / "observer.sqlite"), pytest.raises(StorageBusy):
        await server.calibrating.save("Bench", activate=True)
    with monkeypatch.context() as patch:
        patch.setattr(storage, "save_calibration", full)
        with pytest.raises(StorageFull):
            await server.calibrating.save("Bench", activate=True)
    assert server.calibrating.session.facts() == before
    assert server.calibrating.session.computation.result is not None
    assert peer.calibrating is not None
    await server.calibrating.save("Bench", activate=True)
    assert peer.opened.calibration_yaml == computing.text


@pytest.mark.parametrize(("refusal", "kind"), [("input", FieldError), ("failure", NotAvailable)])
async def test_an_unusable_calibration_is_saved_but_not_activated(
    peer: Any,
    storage: Storage,
    computing: Computing,
    monkeypatch: pytest.MonkeyPatch,
    refusal: Any,
    kind: type[Exception],
    server: Server,
) -> None:
    def other_size(_: OpenSource) -> Any:
        raise ProcessRefused("the calibration is for images of 640x480 pixels", refusal)

    await computed(peer, server, computing)
    with monkeypatch.context() as patch:
        patch.setattr(peer, "_open", other_size)
        with pytest.raises(kind, match=r"Bench is saved, but not in use: .* 640x480"):
            await server.calibrating.save("Bench", activate=True)
    assert [record.name for record in storage.list_calibrations()] == ["Bench"]
    assert names(server) == ["1", "2", "3"]
    assert server.source.wanted.source == "simulated:lab"
    assert storage.active_calibration() is None


async def test_saving_again_keeps_tape_checks(
    peer: Any, storage: Storage, computing: Computing, server: Server
) -> None:
    await computed(peer, server, computing)
    first = await server.calibrating.save("Bench", activate=False)
    checks = [{"measured_m": 2.0}]
    storage.change_calibration(first.id, info={"tape_checks": checks})
    second = await server.calibrating.save("Bench 2", activate=False)
    assert (second.id, second.name) == (first.id, "Bench 2")
    assert second.info["tape_checks"] == checks
    assert second.info["report"] == {"stereo_rms_px": 0.2}


async def test_a_new_name_is_shown_everywhere(
    peer: Any, storage: Storage, computing: Computing, server: Server
) -> None:
    await computed(peer, server, computing)
    record = await server.calibrating.save("Bench", activate=True)
    before = len(opens(peer))
    renamed = await server.calibrating.rename(record.id, "Robot 3")
    assert status(server).calibration == CalibrationReference(record.id, "Robot 3")
    await server.calibrating.activate(record.id)
    assert len(opens(peer)) == before
    with pytest.raises(Conflict, match="Robot 3 is in use"):
        await server.calibrating.delete(record.id)
    assert storage.get_calibration(record.id) == renamed
    with pytest.raises(NotThere):
        await server.calibrating.rename("0" * 64, "x")
