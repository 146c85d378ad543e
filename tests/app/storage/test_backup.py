"""Backup and restoration, from and into databases of both kinds, and what may go wrong."""

from __future__ import annotations

import hashlib
import json
import random
import shutil
import sqlite3
import tarfile
import threading
import zipfile
from collections.abc import Callable
from contextlib import closing
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest

from app.contract.robots import StopMeasured
from app.storage import IncidentRecord, SpeedRow, Storage, StorageError, copying
from app.storage.backup import write_backup
from app.storage.bundle import BackupError, Manifest
from app.storage.restore import Restored, restore_backup

from ..planted_runs import run_folder

TEXT = "%YAML:1.0\n---\nimage_width: 512 # Größe\n"


def speeds(run_id: str, count: int, start: int = 0) -> list[SpeedRow]:
    return [
        SpeedRow(run_id, i / 3, "obstacle", "estimate", i, None if i % 7 == 0 else i / 11, 0.1, 0)
        for i in range(start, start + count)
    ]


def fill(storage: Storage) -> str:
    """Store something of everything that is kept; return the id of its run."""
    data = storage.folder.path
    data.mkdir(exist_ok=True)
    calibration = storage.save_calibration(TEXT, name="lab.yaml", info={"rms": 0.1 + 0.2})
    storage.activate_calibration(calibration.id)
    (data / "take").write_bytes(b"Frame,t\n" * 1000)
    truth = storage.save_truth(data / "take", name="take.csv", format="nexus")
    (data / "take").unlink()
    storage.save_preset("Mine", {"a": None, "b": 1e-17})
    storage.save_preset("before", {})
    storage.save_parameters(3, {"a": 1 / 3}, None)
    run = storage.create_run(
        name="Größe", source="s", parameters={"a": 1 / 3}, versions={"python": "3"},
        calibration_id=calibration.id, truth_id=truth.id, tags=["x", "ä"], notes="n",
        rig="mount: {}\n", record="jpeg",
    )  # fmt: skip
    storage.append_speeds(speeds(run.id, 2100))
    storage.align_run(run.id, {"offset_s": 0.05}, truth_id=truth.id)
    stop = StopMeasured(1.5, None, 0.1, 0.3, None)
    storage.append_incident(IncidentRecord(run.id, "t", None, "guard", "Stop.", None, {"a": stop}))
    storage.record_parameter_revision(run.id, 3, 1, {"a": 2})
    (data / "rig.yaml").write_text("mount: {height_m: 0.5}\n")
    (data / "programmes").mkdir()
    (data / "programmes" / "short.yaml").write_text("name: short\n")
    folder = run_folder(storage, run.id)
    (folder / "recording.mcap").write_bytes(random.Random(1).randbytes(300_000))
    (folder / "truth").mkdir()
    (folder / "truth" / "as uploaded ä.csv").write_text("t\n")
    for place, clip in (("clips", "clip-1.mcap"), ("rings", "ring-1.mcap")):
        (data / place).mkdir()
        (data / place / clip).write_bytes(b"the last half minute")
    (data / "token").write_text("secret")
    return run.id


def contents(storage: Storage, run_id: str) -> dict[str, Any]:
    """Return everything that can be read back of it."""
    data = storage.folder.path
    tops = ("rig.yaml", "programmes", "truths", "runs", "clips", "rings")
    files = [each for top in tops for each in [data / top, *(data / top).rglob("*")]]
    return {
        "run": storage.get_run(run_id),
        "runs": storage.list_runs(),
        "tags": storage.run_tags(),
        "speeds": storage.speeds(run_id),
        "incidents": storage.incidents(run_id),
        "revisions": storage.parameter_revisions(run_id),
        "presets": storage.list_presets(),
        "parameters": storage.load_parameters(),
        "calibrations": storage.list_calibrations(),
        "active": storage.active_calibration(),
        "truths": storage.list_truths(),
        "files": {str(f.relative_to(data)): f.read_bytes() for f in files if f.is_file()},
    }


def back_up(storage: Storage, location: str | Path, target: Path, **given: Any) -> Manifest:
    given = {"recordings": True, "application": "1.2", **given}
    return write_backup(target, storage.folder.path, location, **given)


@pytest.fixture(scope="module")
def kept_once(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    folder = tmp_path_factory.mktemp("kept")
    data = folder / "first"
    with Storage(data / "observer.sqlite") as storage:
        run_id = fill(storage)
        back_up(storage, data / "observer.sqlite", folder / "kept.zip")
    return folder, run_id


@pytest.fixture
def kept(kept_once: tuple[Path, str], tmp_path: Path) -> tuple[Path, str]:
    """A backup of the data folder ``first`` beside it, recordings included, and its run."""
    folder, run_id = kept_once
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    return tmp_path / "kept.zip", run_id


@pytest.mark.parametrize("name", ["kept.zip", "kept.tar"])
def test_everything_is_restored_between_either_kind_of_database(
    location: str | Path, opened: Callable[[], Storage], tmp_path: Path, name: str
) -> None:
    told: list[tuple[int, int | None]] = []
    with opened() as storage:
        run_id = fill(storage)
        before = contents(storage, run_id)
        manifest = back_up(
            storage, location, tmp_path / name, progress=lambda *now: told.append(now)
        )
    assert told[-1][0] == told[-1][1] == sum(each.size for each in manifest.files.values())
    data = tmp_path / "elsewhere"
    done = restore_backup(tmp_path / name, data, data / "observer.sqlite", replace=False)
    assert (done.manifest, done.kept) == (manifest, ())
    with Storage(data / "observer.sqlite") as storage:
        assert contents(storage, run_id) == before
    assert not (data / "token").exists()
    assert [each.name for each in data.iterdir() if each.name.startswith(".")] == []
    # And back, over existing data.
    with pytest.raises(BackupError, match="--replace"):
        restore_backup(tmp_path / name, tmp_path, location, replace=False)
    with opened() as storage:
        storage.delete_run(run_id)
        (tmp_path / "rig.yaml").write_text("changed")
        after = contents(storage, run_id)
    done = restore_backup(tmp_path / name, tmp_path, location, replace=True)
    with opened() as storage:
        assert contents(storage, run_id) == before
        # New row numbers continue after the restored ones.
        storage.append_speeds(speeds(run_id, 1, 2100))
        assert storage.speeds(run_id)[-1].track_id == 2100
    folder, database = done.kept
    assert (folder / "rig.yaml").read_text() == "changed"
    database.rename(folder / "observer.sqlite")
    with Storage(folder / "observer.sqlite") as storage:
        assert contents(storage, run_id) == after


def test_a_backup_during_writes_is_a_consistent_snapshot(
    location: str | Path, opened: Callable[[], Storage], tmp_path: Path
) -> None:
    with opened() as storage:
        run = storage.create_run(name="r", source="s", parameters={}, versions={})
        ending = threading.Event()

        def write() -> None:
            batch = 0
            while not ending.is_set():
                # As a run's rows are written: each batch, then their number.
                storage.append_speeds(speeds(run.id, 50, 50 * batch))
                batch += 1
                storage.update_run(run.id, frames=50 * batch)

        thread = threading.Thread(target=write)
        thread.start()
        try:
            for i in range(3):
                back_up(storage, location, tmp_path / f"{i}.zip")
        finally:
            ending.set()
            thread.join()
    seen = []
    for i in range(3):
        data = tmp_path / f"restored-{i}"
        restore_backup(tmp_path / f"{i}.zip", data, data / "observer.sqlite", replace=False)
        with Storage(data / "observer.sqlite") as storage:
            (found,) = storage.list_runs()
            rows = storage.speeds(run.id)
            assert rows == speeds(run.id, len(rows))
            assert len(rows) - found.frames in (0, 50)
            seen.append(len(rows))
    assert seen == sorted(seen)
    assert seen[-1] > seen[0]


def test_recordings_can_be_excluded_and_stay_in_place(
    kept: tuple[Path, str], tmp_path: Path
) -> None:
    _, run_id = kept
    data = tmp_path / "first"
    recording = data / "runs" / run_id / "recording.mcap"
    content = recording.read_bytes()
    small = tmp_path / "small.zip"
    with Storage(data / "observer.sqlite") as storage:
        manifest = back_up(storage, data / "observer.sqlite", small, recordings=False)
    assert [name for name in manifest.files if name.endswith(".mcap")] == []
    assert f"runs/{run_id}/truth/as uploaded ä.csv" in manifest.files
    assert small.stat().st_size < 250_000
    done = restore_backup(small, data, data / "observer.sqlite", replace=True)
    assert recording.read_bytes() == content
    assert (data / "clips" / "clip-1.mcap").read_bytes() == b"the last half minute"
    with Storage(data / "observer.sqlite") as storage:
        storage.discard_run(run_id)
        storage.purge(timedelta(0))
    assert not recording.exists()
    assert (done.kept[0] / "runs" / run_id / "recording.mcap").read_bytes() == content


def listing(folder: Path) -> dict[str, bytes]:
    # The write-ahead log's index also changes when the database is only read.
    found = (each for each in folder.rglob("*") if each.is_file() and each.suffix != ".sqlite-shm")
    return {str(each): each.read_bytes() for each in found}


def refused(source: Path, data: Path, match: str, **given: Any) -> None:
    """Assert that a restoration is refused with a one-line error and changes nothing."""
    before = listing(data) if data.exists() else None
    with pytest.raises((BackupError, StorageError), match=match) as caught:
        restore_backup(source, data, data / "observer.sqlite", **{"replace": True, **given})
    assert "\n" not in str(caught.value)
    assert (listing(data) or None if data.exists() else None) == (before or None)


def test_restoring_is_refused_while_a_server_uses_the_database(kept: tuple[Path, str]) -> None:
    source, run_id = kept
    data = source.parent / "first"
    with Storage(data / "observer.sqlite") as storage:
        refused(source, data, "a server is using the database")
        assert storage.update_run(run_id, frames=7).frames == 7
    restore_backup(source, data, data / "observer.sqlite", replace=True)


def test_damage_anywhere_is_detected_before_any_change(kept: tuple[Path, str]) -> None:
    source, run_id = kept
    data = source.parent / "first"
    whole = source.read_bytes()
    chance = random.Random(7)
    places = [0, 10, len(whole) - 1, *(chance.randrange(len(whole)) for _ in range(25))]
    harmless = 0
    for place in places:
        damaged = bytearray(whole)
        damaged[place] ^= 0xFF
        source.write_bytes(damaged)
        before = listing(data)
        try:
            restore_backup(source, data, data / "observer.sqlite", replace=True)
        except BackupError:
            assert listing(data) == before
        else:
            # The damaged bytes of the zip carry no data (times, permissions): all was restored.
            harmless += 1
            with Storage(data / "observer.sqlite") as storage:
                assert len(storage.speeds(run_id)) == 2100
    assert harmless < 8
    for length in (0, 1, 1000, len(whole) // 2, len(whole) - 1):
        source.write_bytes(whole[:length])
        refused(source, data, "backup")


def remake(source: Path, change: Callable[[dict[str, bytes]], None]) -> None:
    with zipfile.ZipFile(source) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    change(files)
    with zipfile.ZipFile(source, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)


def listed(name: str, content: bytes) -> Callable[[dict[str, bytes]], None]:
    """Return a change that adds a file and lists it in the manifest with size and checksum."""

    def change(files: dict[str, bytes]) -> None:
        manifest = json.loads(files["manifest.json"])
        entry = {"size": len(content), "sha256": hashlib.sha256(content).hexdigest()}
        manifest["files"][name] = entry
        files["manifest.json"] = json.dumps(manifest).encode()
        files[name] = content

    return change


def without(name: str) -> Callable[[dict[str, bytes]], None]:
    def change(files: dict[str, bytes]) -> None:
        files.pop(name)

    return change


def of_version(number: int) -> Callable[[dict[str, bytes]], None]:
    def change(files: dict[str, bytes]) -> None:
        manifest = json.loads(files["manifest.json"])
        files["manifest.json"] = json.dumps({**manifest, "version": number}).encode()

    return change


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (listed("../evil", b"x"), "an unexpected format"),
        (listed("/evil", b"x"), "an unexpected format"),
        (listed("runs/../../evil", b"x"), "an unexpected format"),
        (listed("runs\\..\\evil", b"x"), "an unexpected format"),
        (listed("token", b"x"), "has unexpected files"),
        (listed("observer.sqlite", b"no database" * 900), "is damaged"),
        (without("observer.sqlite"), "not match its list of files"),
        (without("rig.yaml"), "not match its list of files"),
        (without("manifest.json"), "is not a backup"),
        (lambda files: files.update({"more": b""}), "not match its list of files"),
        (lambda files: files.update({"manifest.json": b"[]"}), "cannot be read"),
        (lambda files: files.update({"rig.yaml": b""}), "has a wrong checksum"),
        (of_version(2), "newer version"),
    ],
)
def test_an_invalid_or_forged_backup_is_refused(
    kept: tuple[Path, str], change: Callable[[dict[str, bytes]], None], match: str
) -> None:
    source, _ = kept
    remake(source, change)
    refused(source, source.parent / "first", match)
    refused(source, source.parent / "new", match, replace=False)
    assert not (source.parent / "evil").exists()


def test_a_backup_of_a_newer_version_is_refused(kept: tuple[Path, str], tmp_path: Path) -> None:
    source, _ = kept
    database = tmp_path / "newer.sqlite"
    with zipfile.ZipFile(source) as archive:
        database.write_bytes(archive.read("observer.sqlite"))
    with closing(sqlite3.connect(database)) as connection, connection:
        connection.execute("UPDATE alembic_version SET version_num = '9999'")
    remake(source, listed("observer.sqlite", database.read_bytes()))
    refused(source, tmp_path / "first", "newer version")


def test_links_in_a_tar_are_refused(tmp_path: Path) -> None:
    with tarfile.open(tmp_path / "evil.tar", "w") as archive:
        link = tarfile.TarInfo("runs")
        link.type, link.linkname = tarfile.SYMTYPE, "/etc"
        archive.addfile(link)
    refused(tmp_path / "evil.tar", tmp_path / "data", "entries other than files")


def test_a_swap_that_fails_halfway_is_rolled_back(
    kept: tuple[Path, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    source, _ = kept
    data = source.parent / "first"
    rename = Path.rename
    failed: list[str] = []
    for name in ("runs", "truths", "observer.sqlite", ".observer.sqlite.restoring"):

        def fail(self: Path, target: Path, name: str = name) -> Path:
            if self.name == name and name not in failed:
                failed.append(name)
                raise OSError(5, "Input/output error")
            return rename(self, target)

        with monkeypatch.context() as patch:
            patch.setattr(Path, "rename", fail)
            refused(source, data, "nothing was changed: ")
        assert failed[-1] == name
        assert not [each for each in data.iterdir() if each.name.startswith(("before", "."))]


def test_rows_that_a_server_refuses_change_nothing(
    kept: tuple[Path, str],
    new_database: Callable[[], str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    source, run_id = kept
    url, data = new_database(), tmp_path / "data"
    with Storage(url, folder=data) as storage:
        other = storage.create_run(name="other", source="s", parameters={}, versions={})
        (run_folder(storage, other.id) / "recording.mcap").write_bytes(b"x")
    copy = copying._copy

    def interrupted(*given: Any) -> None:
        copy(*given)
        raise StorageError("the server is gone")

    with monkeypatch.context() as patch:
        patch.setattr(copying, "_copy", interrupted)
        # The existing data are copied aside as well; that copy succeeds.
        patch.setattr("app.storage.restore.copy_tables", lambda _, file: file.write_bytes(b""))
        with pytest.raises(StorageError, match="is gone"):
            restore_backup(source, data, url, replace=True)
    with Storage(url, folder=data) as storage:
        assert [run.id for run in storage.list_runs()] == [other.id]
        assert storage.folder.recording_bytes(other.id) == 1
    with (
        Storage(url, folder=data),
        pytest.raises(BackupError, match="a server is using the database"),
    ):
        restore_backup(source, data, url, replace=True)
    restore_backup(source, data, url, replace=True)
    with Storage(url, folder=data) as storage:
        assert [run.id for run in storage.list_runs()] == [run_id]


def test_a_failed_backup_is_reported_and_leaves_nothing(tmp_path: Path) -> None:
    def back_up_of(data: Path, target: Path) -> None:
        write_backup(target, data, data / "observer.sqlite", recordings=True, application="1")

    with pytest.raises(BackupError, match="there is no database"):
        back_up_of(tmp_path / "nothing", tmp_path / "a.zip")
    data = tmp_path / "data"
    with Storage(data / "observer.sqlite"):
        pass
    with pytest.raises(BackupError, match=r"must end in \.zip or \.tar"):
        back_up_of(data, tmp_path / "a.rar")
    with pytest.raises(BackupError, match="cannot write"):
        back_up_of(data, tmp_path / "no folder" / "a.zip")
    (data / "observer.sqlite").write_bytes(b"no database" * 900)
    with pytest.raises(StorageError, match="is damaged"):
        back_up_of(data, tmp_path / "a.zip")
    with closing(sqlite3.connect(data / "other.sqlite")) as connection:
        connection.execute("CREATE TABLE recipes (name TEXT)")
    with pytest.raises(BackupError, match="does not belong to dynamic-observer"):
        write_backup(
            tmp_path / "a.zip", data, data / "other.sqlite", recordings=True, application="1"
        )
    assert [each.name for each in tmp_path.iterdir()] == ["data"]


def test_too_little_space_is_reported_beforehand(
    kept: tuple[Path, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    source, _ = kept
    monkeypatch.setattr("app.storage.folder.DataFolder.free_bytes", lambda _: 1000)
    refused(source, source.parent / "new", "MB are free", replace=False)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_a_disk_that_fills_up_while_restoring_is_not_reported_as_damage(
    kept: tuple[Path, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    source, _ = kept
    usual = Path.open

    def full(path: Path, mode: str = "r", **given: Any) -> Any:
        staged = path.parent.name.startswith(".restoring-")
        return usual(Path("/dev/full") if staged else path, mode, **given)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", full)
        refused(source, source.parent / "first", "cannot be put into .*No space left")


def test_a_restored_running_run_is_interrupted_at_the_next_start(
    tmp_path: Path,
) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    with Storage(first / "observer.sqlite") as storage:
        run = storage.create_run(name="r", source="s", parameters={}, versions={})
        back_up(storage, first / "observer.sqlite", tmp_path / "a.tar")
    done: Restored = restore_backup(
        tmp_path / "a.tar", second, second / "observer.sqlite", replace=False
    )
    assert done.manifest.recordings
    with Storage(second / "observer.sqlite") as storage:
        assert [each.id for each in storage.mark_interrupted_runs()] == [run.id]
