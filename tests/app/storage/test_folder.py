"""The data folder, and what it takes of the disk."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.storage import DataFolder, Storage, StorageError, StorageMissing

BIG = 200_000


def test_disk_use_by_what_it_is_for(tmp_path: Path) -> None:
    with Storage(tmp_path / "observer.sqlite") as storage:
        run = storage.create_run(name="r", source="s", parameters={}, versions={})
        folder = storage.folder.make_run(run.id)
        (folder / "recording.mcap").write_bytes(b"x" * BIG)
        (folder / "truth").mkdir()
        (folder / "truth" / "take.csv").write_bytes(b"x" * BIG)
        (tmp_path / "truths").mkdir()
        (tmp_path / "truths" / "a.csv").write_bytes(b"x" * 2 * BIG)
        (tmp_path / "observer.before-migration-from-0003-x.sqlite").write_bytes(b"x" * 3 * BIG)
        (tmp_path / "before-restore-x").mkdir()
        (tmp_path / "before-restore-x" / "observer.sqlite").write_bytes(b"x" * BIG)
        (tmp_path / "rig.yaml").write_bytes(b"x")
        use = storage.disk_use()
        assert storage.folder.run_bytes(run.id) == use.runs[run.id]
    assert list(use.runs) == [run.id]
    assert 2 * BIG <= use.runs[run.id] < 2.5 * BIG
    assert 2 * BIG <= use.truths < 2.5 * BIG
    assert 4 * BIG <= use.copies < 4.5 * BIG
    assert 0 < use.other < 0.1 * BIG
    assert use.database > 50_000
    assert 8 * BIG < use.total < use.free


def test_nothing_takes_nothing(tmp_path: Path) -> None:
    use = DataFolder(tmp_path / "not yet" / "made").disk_use(None)
    assert (use.total, use.runs) == (0, {})
    assert use.free > 0


@pytest.mark.parametrize("id", ["", ".", "..", "../x", "a/b", "a\0", "a" * 101, ".deleted-a"])
def test_no_id_leads_out_of_the_folder(tmp_path: Path, id: str) -> None:
    with pytest.raises(StorageMissing):
        DataFolder(tmp_path).run(id)


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "runs").write_text("in the way")
    with pytest.raises(StorageError, match="cannot be made"):
        DataFolder(tmp_path).make_run("a")
