"""The run that a command works on, by the beginning of its id."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from app.storage import Storage

from ..planted_runs import run_folder
from .shell import Done


def test_a_deleted_run_is_marked_among_those_that_match(
    shell: Callable[..., Done], tmp_path: Path
) -> None:
    with Storage(tmp_path / "observer.sqlite", folder=tmp_path) as storage:
        kept, gone = (
            storage.create_run(name=name, source="s", parameters={}, versions={})
            for name in ("kept", "gone")
        )
        for run in (kept, gone):
            (run_folder(storage, run.id) / "recording.mcap").write_bytes(b"x")
        storage.discard_run(gone.id)
    both = [kept.id, f"{gone.id} (deleted)"]
    done = shell("report", kept.id[:4], "--data", str(tmp_path), "--output", "r.html")
    assert done.code == 2
    assert f"matches several runs ({', '.join(sorted(both))}); give more of the id" in done.err
