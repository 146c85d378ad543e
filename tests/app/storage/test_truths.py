"""Truth files: one per content, kept as long as a run needs it."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import pytest

from app.storage import Storage, StorageError, StorageMissing

CONTENT = b"Frame,t\n1,0.01\n" * 100_000


@pytest.fixture
def take(tmp_path: Path) -> Path:
    file = tmp_path / "upload"
    file.write_bytes(CONTENT)
    return file


def test_a_truth_is_identified_by_its_content(opened: Callable[[], Storage], take: Path) -> None:
    with opened() as storage:
        made = storage.save_truth(
            take, name="Take 1.CSV", format="nexus", info={"bodies": ["Wagen", "Größe"]}
        )
        assert made.id == hashlib.sha256(CONTENT).hexdigest()
        assert made.file == f"{made.id}.csv"
        again = storage.save_truth(take, name="better", format="nexus", info=made.info)
        assert (again.id, again.created_at, again.file) == (made.id, made.created_at, made.file)
    take.unlink()
    with opened() as storage:
        assert storage.list_truths() == [again]
        assert storage.truth_file(made.id).read_bytes() == CONTENT
        assert [each.name for each in (storage.folder.path / "truths").iterdir()] == [made.file]


def test_the_file_is_deleted_with_the_last_run_that_needs_it(storage: Storage, take: Path) -> None:
    truth = storage.save_truth(take, name="take.c3d", format="c3d")
    run = storage.create_run(name="r", source="s", parameters={}, versions={}, truth_id=truth.id)
    assert storage.delete_truth(truth.id) is True
    assert storage.delete_truth(truth.id) is False
    assert storage.list_truths() == []
    kept = storage.truth_file(truth.id)
    storage.purge(timedelta(0))
    assert kept.exists()
    storage.discard_run(run.id)
    storage.purge(timedelta(0))
    assert not kept.exists()
    assert storage.get_truth(truth.id) is None


def test_a_truth_without_runs_is_deleted_immediately(storage: Storage, take: Path) -> None:
    truth = storage.save_truth(take, name="take.csv", format="plain")
    file = storage.truth_file(truth.id)
    assert storage.delete_truth(truth.id) is True
    assert not file.exists()
    with pytest.raises(StorageMissing, match="no ground truth"):
        storage.truth_file(truth.id)


def test_no_name_escapes_the_folder(storage: Storage, take: Path) -> None:
    truth = storage.save_truth(take, name="../../evil/./..", format="plain")
    assert truth.file == truth.id
    assert storage.truth_file(truth.id).parent == storage.folder.path / "truths"


def test_a_truth_with_a_missing_file_is_reported(storage: Storage, take: Path) -> None:
    truth = storage.save_truth(take, name="take.csv", format="plain")
    storage.truth_file(truth.id).unlink()
    with pytest.raises(StorageMissing, match="is missing"):
        storage.truth_file(truth.id)


def test_a_file_that_cannot_be_stored_leaves_nothing(storage: Storage, tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="cannot be stored"):
        storage.save_truth(tmp_path / "nothing", name="take.csv", format="plain")
    assert storage.list_truths() == []
    folder = storage.folder.path / "truths"
    assert not folder.exists() or os.listdir(folder) == []
