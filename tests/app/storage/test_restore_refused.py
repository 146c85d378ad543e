"""Restorations that are refused or fail: they change nothing."""

from __future__ import annotations

import hashlib
import json
import random
import sqlite3
import tarfile
import zipfile
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from app.storage import Storage, StorageError, copying
from app.storage.bundle import BackupError
from app.storage.restore import restore_backup

from ..planted_runs import run_folder


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
