"""``purge`` as a shell sees it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from app.storage import Storage

from ..planted_runs import run_folder
from .shell import Done


def test_deleted_runs_are_purged_by_age_or_all(shell: Callable[..., Done], tmp_path: Path) -> None:
    with Storage(tmp_path / "observer.sqlite", folder=tmp_path) as storage:
        kept, gone = (
            storage.create_run(name=name, source="s", parameters={}, versions={})
            for name in ("kept", "gone")
        )
        storage.discard_run(gone.id)
        recording = run_folder(storage, gone.id) / "recording.mcap"
        recording.write_bytes(b"x" * 4096)
    options = ["--data", str(tmp_path)]
    early = shell("purge", *options)
    assert (early.code, early.out) == (0, "")
    assert early.err.startswith("0 runs removed")
    assert recording.exists()
    assert shell("purge", "--days", "-1", *options).code == 2
    done = shell("purge", "--days", "0", *options)
    assert done.err.startswith("1 runs removed")
    assert not recording.parent.exists()
    with Storage(tmp_path / "observer.sqlite", folder=tmp_path) as storage:
        assert [run.id for run in storage.list_runs()] == [kept.id]
