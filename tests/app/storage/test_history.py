"""Runs found again, annotated, aligned with truth, deleted with undo."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from app.storage import RunRecord, RunState, SpeedRow, Storage, StorageMissing

from ..planted_runs import run_folder


def begin(storage: Storage, name: str, **given: object) -> RunRecord:
    return storage.create_run(
        name=name,
        source="simulated:lab",
        parameters={},
        versions={},
        **given,  # type: ignore[arg-type]
    )


def names(storage: Storage, text: str = "", **given: object) -> list[str]:
    found = storage.find_runs(text, **given)  # type: ignore[arg-type]
    assert found.total >= len(found.runs)
    return [run.name for run in found.runs]


def test_all_fields_of_a_run_are_stored(opened: Callable[[], Storage]) -> None:
    with opened() as storage:
        made = begin(
            storage, "r", rig="mount: {}\n", record="lossless", tags=["b", " a ", "b", ""],
            notes="floor wet", rerun_of="of before",
        )  # fmt: skip
        assert (made.tags, made.notes, made.rig, made.record) == (
            ("a", "b"), "floor wet", "mount: {}\n", "lossless",
        )  # fmt: skip
        made = storage.update_run(made.id, recording_bytes=5_000_000_000)
    with opened() as storage:
        assert storage.get_run(made.id) == made
        assert made.recording_bytes == 5_000_000_000
        assert (made.rerun_of, made.aligned) == ("of before", False)


def test_runs_are_searched_by_words_in_name_notes_and_tags(storage: Storage) -> None:
    first = begin(storage, "Fahrt an der Größe vorbei")
    storage.annotate_run(first.id, notes="boden NASS\nzweiter Versuch", tags=["Vicon", "100% ok"])
    begin(storage, "drive_2")
    begin(storage, "drive 12", tags=["vicon"])
    assert names(storage) == ["drive 12", "drive_2", first.name]
    assert names(storage, "vicon") == ["drive 12", first.name]
    assert names(storage, "GRÖSSE nass") == [first.name]
    assert names(storage, "größe trocken") == []
    # The database's wildcards are ordinary characters here.
    assert names(storage, "%") == [first.name]
    assert names(storage, "e_2") == ["drive_2"]
    assert names(storage, "\\") == []
    storage.update_run(first.id, name="anders")
    assert names(storage, "größe") == []
    assert names(storage, "anders vicon") == ["anders"]


def test_runs_are_searched_by_tag_in_pages(storage: Storage) -> None:
    for i in range(5):
        begin(storage, str(i), tags=["all", "even" if i % 2 == 0 else "odd"])
    assert names(storage, tags=["even"]) == ["4", "2", "0"]
    assert names(storage, tags=["even", "all"]) == ["4", "2", "0"]
    assert names(storage, tags=["even", "odd"]) == []
    assert names(storage, tags=["eve"]) == []
    assert storage.run_tags() == {"all": 5, "even": 3, "odd": 2}
    page = storage.find_runs(tags=["all"], limit=2, offset=1)
    assert ([run.name for run in page.runs], page.total) == (["3", "2"], 5)


def test_annotations_do_not_count_as_a_heartbeat(storage: Storage, run: RunRecord) -> None:
    changed = storage.annotate_run(run.id, name="other", tags=["x"], notes="n")
    assert changed == replace(run, name="other", tags=("x",), notes="n")
    assert storage.annotate_run(run.id) == changed
    assert storage.annotate_run(run.id, tags=["y", "x"]).tags == ("x", "y")
    assert storage.annotate_run(run.id, tags=[]).tags == ()
    assert storage.get_run(run.id) == replace(changed, tags=())
    with pytest.raises(StorageMissing, match="no run nothing"):
        storage.annotate_run("nothing", notes="n")


def test_a_deleted_run_can_be_recovered_for_a_week(storage: Storage, run: RunRecord) -> None:
    kept = begin(storage, "kept")
    recording = run_folder(storage, run.id) / "recording.mcap"
    recording.write_bytes(b"x")
    gone = storage.discard_run(run.id)
    assert gone.deleted_at is not None
    assert storage.discard_run(run.id) == gone
    assert names(storage) == ["kept"]
    assert names(storage, deleted=True) == ["first"]
    assert storage.purge() == []
    assert storage.recover_run(run.id) == run
    assert names(storage) == ["kept", "first"]

    storage.discard_run(run.id)
    assert storage.purge(timedelta(0)) == [run.id]
    assert not recording.parent.exists()
    assert storage.get_run(run.id) is None
    assert storage.get_run(kept.id) == kept
    with pytest.raises(StorageMissing):
        storage.recover_run(run.id)


def test_permanent_deletion_removes_tags_and_files(storage: Storage) -> None:
    run = begin(storage, "r", tags=["a"])
    storage.append_speeds([SpeedRow(run.id, 0.0, "obstacle", "estimate", 1, 0.5, 0.1, 0)])
    (run_folder(storage, run.id) / "recording.mcap").write_bytes(b"x" * 10_000)
    # A crash in the middle of an earlier deletion.
    left = storage.folder.path / "runs" / ".deleted-other-1"
    left.mkdir()
    assert storage.delete_run(run.id) is True
    assert storage.run_tags() == {}
    assert storage.speeds(run.id) == []
    storage.purge()
    assert list((storage.folder.path / "runs").iterdir()) == []


def test_an_interrupted_run_has_its_recording_size(storage: Storage, run: RunRecord) -> None:
    (run_folder(storage, run.id) / "recording.mcap").write_bytes(b"x" * 1234)
    (interrupted,) = storage.mark_interrupted_runs()
    assert (interrupted.state, interrupted.recording_bytes) == (RunState.INTERRUPTED, 1234)


def test_a_run_can_be_realigned_with_truth(
    storage: Storage, run: RunRecord, tmp_path: Path
) -> None:
    def row(time: float, source: str = "truth", body: str | None = "Cart") -> SpeedRow:
        return SpeedRow(run.id, time, "obstacle", source, None, 0.3, None, 0, body)  # type: ignore[arg-type]

    seen = row(0.0, "estimate", None)
    storage.append_speeds([row(0.0, body="Robot"), seen])
    (tmp_path / "take.csv").write_text("t,x\n")
    truth = storage.save_truth(tmp_path / "take.csv", name="take.csv", format="plain")
    found = {"offset_s": 0.1 + 0.2, "bodies": {"1": "Cart"}, "residual_mps": None}
    storage.align_run(run.id, found, truth_id=truth.id, rows=[row(0.5), row(1.0)])
    assert storage.speeds(run.id) == [seen, row(0.5), row(1.0)]
    aligned = storage.get_run(run.id)
    assert aligned == replace(run, alignment=found, truth_id=truth.id)
    with pytest.raises(StorageMissing):
        storage.align_run(run.id, {}, truth_id="0" * 64)
    with pytest.raises(ValueError, match="only ground-truth speeds"):
        storage.align_run(run.id, {}, rows=[seen])
    assert storage.get_run(run.id) == aligned
    storage.align_run(run.id, None)
    assert storage.get_run(run.id) == run
    assert storage.speeds(run.id) == [seen]
    assert run.started_at < datetime.now(UTC).isoformat()
