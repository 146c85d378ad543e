"""Damaged backups and database rows: what is read is what was written, or one sentence says
why not."""

from __future__ import annotations

import io
import json
import shutil
import sqlite3
import tarfile
import zipfile
from collections.abc import Iterator
from contextlib import closing
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pydantic import TypeAdapter

from app.contract.calibrating import Calibration
from app.contract.parameters import Preset
from app.contract.runs import Run
from app.contract.truths import TruthEntry
from app.contract.values import filled
from app.server import Server
from app.server.calibrations.library import with_tape_check
from app.server.parameters.in_force import ParametersInForce
from app.server.runs.truths import truth_entry
from app.storage import Storage
from app.storage.bundle import BackupError, Manifest, bundle_writer, open_bundle
from app.storage.records import RunState
from observer.errors import DynamicObserverError
from observer.navigation.parameters import AllParameters

from ...damage import (
    assert_one_sentence,
    damaged,
    damaged_json,
    examples,
    hostile_bytes,
    read_or_refused,
)
from ..engine_values import rectified_calibration
from ..peer_engine import PeerEngine

FILES = {"observer.sqlite": b"rows" * 40, "truths/a.csv": b"t,x,y,z\n0,1,2,3\n"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("damage")


@pytest.fixture(scope="module")
def wholes(folder: Path) -> tuple[bytes, ...]:
    """The same backup as a zip and as a tar."""
    made = []
    for ending in ("zip", "tar"):
        target = folder / f"backup.{ending}"
        with bundle_writer(target) as writer:
            for number, (name, content) in enumerate(FILES.items()):
                (folder / str(number)).write_bytes(content)
                writer.add(name, folder / str(number))
            writer.finish(Manifest("2026-01-01T00:00:00Z", "0.1.0", "0001", False, writer.files))
        made.append(target.read_bytes())
    return tuple(made)


def restored(path: Path) -> dict[str, bytes]:
    with open_bundle(path) as bundle, TemporaryDirectory() as folder:
        target = Path(folder)
        for name in bundle.manifest.files:
            bundle.extract(name, target / name)
        return {name: (target / name).read_bytes() for name in bundle.manifest.files}


@pytest.mark.parametrize("which", [0, 1], ids=["zip", "tar"])
def test_a_backup_is_read_back_unchanged(
    folder: Path, wholes: tuple[bytes, ...], which: int
) -> None:
    (folder / "whole").write_bytes(wholes[which])
    assert restored(folder / "whole") == FILES


@pytest.mark.parametrize("which", [0, 1], ids=["zip", "tar"])
@examples(60)
@given(data=st.data())
def test_a_damaged_backup_is_refused_or_intact(
    folder: Path, wholes: tuple[bytes, ...], which: int, data: st.DataObject
) -> None:
    path = folder / "damaged"
    path.write_bytes(data.draw(damaged([wholes[which]], (b"PK\x05\x06", b"ustar"))))
    found = read_or_refused(lambda: restored(path), BackupError)
    # The list of files has no checksum of its own: the name of a file may have changed.
    assert found is None or sorted(found.values()) == sorted(FILES.values())


@examples(40)
@given(hostile_bytes((b"PK\x03\x04", b"PK\x05\x06", b"ustar\x0000")))
@example(tarfile.TarInfo("manifest.json").tobuf() + bytes(1024))
def test_an_invalid_backup_is_refused(folder: Path, content: bytes) -> None:
    path = folder / "none"
    path.write_bytes(content)
    with pytest.raises(BackupError):
        restored(path)


@examples(40)
@given(data=st.data())
def test_a_damaged_file_list_is_refused_or_intact(folder: Path, data: st.DataObject) -> None:
    whole = {
        "kind": "dynamic-observer backup", "version": 1, "made_at": "2026", "application": "0.1",
        "revision": "0001", "recordings": False,
        "files": {"observer.sqlite": {"size": 4, "sha256": "0" * 64}},
    }  # fmt: skip
    text = data.draw(damaged([json.dumps(whole).encode()], (b"null", b"[]", b"{}", b'"\\u0000"')))
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("manifest.json", text)
        archive.writestr("observer.sqlite", b"rows")
    path = folder / "listed"
    path.write_bytes(file.getvalue())
    read_or_refused(lambda: restored(path), BackupError)


# --- rows of the database ----------------------------------------------------------------------

VALUES = dict(AllParameters().flat())
SAVED = {"revision": 7, "values": VALUES, "preset": "mine"}
INFO: dict[str, Any] = {
    "width": 512, "height": 256, "baseline_m": 0.12, "hfov_deg": 60.1, "rectified": True,
    "origin": "calibrated here", "notes": ["a"],
    "bound": {"devices": ["/dev/a", "/dev/b"], "settings": [{"size": "512x256"}, {}]},
    "report": {"board": {"square_m": 0.025}, "depth_bias": [], "held_out": {"lasting_px": 0.1}},
    "tape_checks": [{
        "measured_m": 1.0, "stated_m": 1.01, "expected_m": 0.02, "agrees": True, "sentence": "a",
        "at": "2026-01-01T00:00:00Z",
    }],
}  # fmt: skip
TRUTH_INFO: dict[str, Any] = {
    "format": "csv", "rate_hz": 100.0, "duration_s": 2.0, "notes": [],
    "bodies": [{
        "name": "cart", "has_orientation": False, "samples": 200, "seen": 200, "gaps": 0,
        "from_s": 0.0, "to_s": 2.0, "extent_m": [0.8, 0.0, 0.0], "highest_speed_mps": 0.4,
    }],
    "reading": {"rate_hz": None, "angles": None},
}  # fmt: skip
WORDS = ("mine", "one_camera", "following.growth_noise", {"tracking.gate": 3.0}, 2**31)
AS_PRESETS, AS_RUN = TypeAdapter(list[Preset]), TypeAdapter(Run)
AS_CALIBRATION, AS_TRUTH = TypeAdapter(Calibration), TypeAdapter(TruthEntry)


@pytest.fixture(scope="module")
def storage(folder: Path, migrated_file: Path) -> Iterator[Storage]:
    """A database with two presets, parameters, a calibration and a run."""
    file = folder / "database" / "observer.sqlite"
    file.parent.mkdir()
    shutil.copy(migrated_file, file)
    with Storage(file) as storage:
        storage.save_parameters(7, VALUES, "mine")
        storage.save_preset("mine", VALUES)
        storage.save_preset("whole", VALUES)
        kept = storage.save_calibration(rectified_calibration(), name="a", info=INFO)
        storage.activate_calibration(kept.id)
        storage.create_run(name="a", source="simulated:lab", parameters=VALUES, versions={})
        (folder / "truth.csv").write_bytes(FILES["truths/a.csv"])
        storage.save_truth(folder / "truth.csv", name="truth.csv", format="csv", info=TRUTH_INFO)
        yield storage


# Every place where JSON is kept, and a valid value.
PLACES: dict[str, tuple[str, Any]] = {
    "preset": ("presets SET \"values\" = ? WHERE name = 'mine'", VALUES),
    "parameters": ("settings SET value = ? WHERE key = 'parameters.current'", SAVED),
    "calibration": ("calibrations SET info = ?", INFO),
    "parameters of a run": ("runs SET parameters = ?", VALUES),
    "versions of a run": ("runs SET versions = ?", {"numpy": "2.0"}),
    "alignment of a run": ("runs SET alignment = ?", {"time_offset": {}}),
    "ground truth": ("truths SET info = ?", TRUTH_INFO),
}


@pytest.mark.parametrize("place", PLACES)
@examples(8)
@given(data=st.data())
def test_damaged_rows_break_neither_startup_nor_listing(
    storage: Storage, engine: PeerEngine, place: str, data: st.DataObject
) -> None:
    where, whole = PLACES[place]
    text = json.dumps(whole).encode()
    content = data.draw(damaged_json(whole, WORDS) | damaged([text]) | hostile_bytes())
    put(storage, where, content)
    try:
        read_or_refused(lambda: hold(storage, engine))
    finally:
        put(storage, where, text)


@pytest.mark.parametrize("place", ["preset", "parameters"])
@pytest.mark.parametrize("content", [b"{", b"\xff", b"[]", b"5", b"[" * 100_000])
def test_skipped_values_are_reported(
    storage: Storage, engine: PeerEngine, place: str, content: bytes
) -> None:
    where, whole = PLACES[place]
    put(storage, where, content)
    try:
        (warning,) = hold(storage, engine)
        assert "'mine' is damaged" in warning or "saved parameters" in warning
        if place == "preset":
            storage.save_preset("mine", VALUES)
            assert hold(storage, engine) == []
    finally:
        put(storage, where, json.dumps(whole).encode())


def test_a_run_of_an_unknown_state_is_listed_as_failed(storage: Storage) -> None:
    put(storage, "runs SET state = ?", b"dreaming")
    try:
        (run,) = storage.list_runs()
        assert run.state is RunState.FAILED
        assert run.reason == "the state of this run is damaged in the database and cannot be read"
    finally:
        put(storage, "runs SET state = ?", b"running")


def put(storage: Storage, where: str, content: bytes) -> None:
    """Write the bytes as text, as a manual edit or a damaged page of the file does."""
    statement = f"UPDATE {where.replace('?', 'CAST(? AS TEXT)')}"
    with closing(sqlite3.connect(storage.file)) as connection, connection:
        assert connection.execute(statement, [content]).rowcount == 1


@pytest.fixture(scope="module")
def engine() -> PeerEngine:
    """One for all tests: it holds descriptors."""
    return PeerEngine()


def hold(storage: Storage, engine: PeerEngine) -> list[str]:
    """Load what the server loads at its start, list what the page lists; return the warnings."""
    server = Server(engine, storage, source="camera:/dev/a,/dev/b")
    server._load()
    for warning in server.shared.warnings:
        assert_one_sentence(warning)
    assert isinstance(server.parameters.current, ParametersInForce)
    presets = server.parameters.presets()
    AS_PRESETS.dump_json(presets)
    assert {"default", "paper", "whole"} <= {each.name for each in presets}
    for each in presets:
        read_or_refused(partial(server.parameters.plan, each.name, {}), DynamicObserverError)
    for record in server.storage.list_calibrations():
        AS_CALIBRATION.dump_json(server.calibrating.entry(record))
        checks = with_tape_check(record, 1.01, 1.0)
        json.dumps(checks, allow_nan=False)
        assert (checks[-1]["stated_m"], checks[-1]["measured_m"]) == (1.01, 1.0)
    (run,) = server.storage.list_runs()
    AS_RUN.dump_json(filled(Run, run))
    (truth,) = server.storage.list_truths()
    AS_TRUTH.dump_json(truth_entry(truth))
    return server.shared.warnings
