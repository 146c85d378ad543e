"""The data folder, and its disk usage."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.storage import DataFolder, Storage, StorageMissing

from ..planted_runs import run_folder

BIG = 200_000


def test_disk_use_counts_everything_once(tmp_path: Path) -> None:
    with Storage(tmp_path / "observer.sqlite") as storage:
        run = storage.create_run(name="r", source="s", parameters={}, versions={})
        folder = run_folder(storage, run.id)
        before = storage.folder.disk_use(storage.file)
        assert before.total > 50_000
        (folder / "recording.mcap").write_bytes(b"x" * BIG)
        (folder / "truth").mkdir()
        (folder / "truth" / "take.csv").write_bytes(b"x" * BIG)
        (tmp_path / "observer.before-migration-from-0003-x.sqlite").write_bytes(b"x" * 3 * BIG)
        with (tmp_path / "sparse").open("wb") as sparse:
            sparse.truncate(100 * BIG)
        use = storage.folder.disk_use(storage.file)
    assert 5 * BIG <= use.total - before.total < 5.5 * BIG
    assert use.total < use.free


def test_a_database_elsewhere_counts_with_its_log(tmp_path: Path) -> None:
    database = tmp_path / "elsewhere" / "observer.sqlite"
    database.parent.mkdir()
    for name in ("observer.sqlite", "observer.sqlite-wal", "other"):
        (database.parent / name).write_bytes(b"x" * BIG)
    assert 2 * BIG <= DataFolder(tmp_path / "data").disk_use(database).total < 2.5 * BIG


def test_a_missing_folder_uses_no_space(tmp_path: Path) -> None:
    use = DataFolder(tmp_path / "not yet" / "made").disk_use(None)
    assert use.total == 0
    assert use.free > 0


@pytest.mark.parametrize("id", ["", ".", "..", "../x", "a/b", "a\0", "a" * 101, ".deleted-a"])
def test_no_id_escapes_the_folder(tmp_path: Path, id: str) -> None:
    with pytest.raises(StorageMissing):
        DataFolder(tmp_path).run(id)
