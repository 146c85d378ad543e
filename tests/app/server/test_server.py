"""The start and the end of a server over a peer engine."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from app.contract.commands import OpenSource
from app.contract.events import EngineState
from app.storage import RunState, Storage

from .servers import begin, started


async def test_the_server_survives_a_first_source_that_cannot_be_opened(
    peer: Any, storage: Storage
) -> None:
    async with started(peer, storage, "missing") as server:
        assert server.source.state.state is EngineState.FAILED
        assert "name one that exists" in str(server.source.state.reason)
        await server.source.open("simulated:lab", None)
        assert server.source.state.state is EngineState.PREVIEW


async def test_stopping_the_server_marks_the_run_as_interrupted(
    peer: Any, storage: Storage, tmp_path: Path
) -> None:
    async with started(peer, storage) as server:
        await begin(server)
        peer.observe()
    with Storage(tmp_path / "observer.sqlite") as again:
        (record,) = again.list_runs()
        assert (record.state, record.frames) == (RunState.INTERRUPTED, 1)
        assert "shut down" in str(record.reason)


async def test_runs_of_a_killed_server_are_interrupted(peer: Any, storage: Storage) -> None:
    with storage:
        storage.create_run(name="x", source="s", parameters={}, versions={})

    async with started(peer, storage) as server:
        (record,) = await server.runs.archive.newest()
        assert record.state is RunState.INTERRUPTED


async def test_saved_parameters_and_calibration_are_restored(
    peer: Any, storage: Storage, calibration_yaml: Any
) -> None:
    with storage:
        values = {"flow.window_px": 31, "gone.parameter": 1}
        storage.save_parameters(5, values, None)
        record = storage.save_calibration(calibration_yaml(), name="mine", info={})
        storage.activate_calibration(record.id)

    async with started(peer, storage) as server:
        assert server.parameters.current.values.flow.window_px == 31
        assert server.parameters.current.revision == 6
        assert "gone.parameter" in server.shared.warnings[0]
        assert peer.opened.calibration_yaml == calibration_yaml()


async def test_a_calibration_that_no_longer_fits_is_dropped_with_a_warning(
    peer: Any, storage: Storage, calibration_yaml: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    with storage:
        record = storage.save_calibration(calibration_yaml(), name="mine", info={})
        storage.activate_calibration(record.id)
    plain_open = peer._open

    def choosy(command: OpenSource) -> Any:
        if command.calibration_yaml is not None:
            from app.runtime.errors import ProcessRefused

            raise ProcessRefused("the calibration is for images of another size", "input")
        return plain_open(command)

    monkeypatch.setattr(peer, "_open", choosy)

    async with started(peer, storage) as server:
        assert server.source.state.state is EngineState.PREVIEW
        assert "mine" in server.shared.warnings[0]
        assert server.source.wanted.calibration is None
