"""The truth kept with a run, as commands use it."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.storage import RunRecord, Storage, StorageMissing
from app.storage.comparison import kept_comparison

from ..planted_runs import run_folder


def laid(storage: Storage, run: RunRecord, truth_id: str | None, **kept: object) -> RunRecord:
    storage.align_run(run.id, {"time": {}, **kept}, truth_id=truth_id)
    found = storage.get_run(run.id)
    assert found is not None
    assert found.aligned
    return found


def test_a_truth_file_is_reread_with_its_original_options(
    storage: Storage, run: RunRecord, tmp_path: Path
) -> None:
    file = tmp_path / "take.csv"
    file.write_text("t,x,y,z\n")
    info = {"reading": {"rate_hz": 50.0, "angles": None}}
    truth = storage.save_truth(file, name="take.csv", format="plain CSV", info=info)
    record = laid(storage, run, truth.id)
    told = kept_comparison(record, storage)
    assert told == {
        "alignment": {"time": {}},
        "truth": {
            "path": str(storage.truth_file(truth.id).absolute()), "name": "take.csv",
            "rate_hz": 50.0, "angles": None,
        },
    }  # fmt: skip
    record = laid(storage, run, truth.id, reading={"rate_hz": None, "angles": "helical"})
    told = kept_comparison(record, storage)
    assert told["truth"]["angles"] == "helical"
    assert told["truth"]["rate_hz"] is None
    storage.truth_file(truth.id).unlink()
    with pytest.raises(StorageMissing, match=r"take\.csv is missing"):
        kept_comparison(record, storage)


def test_live_motion_capture_is_read_from_a_recording(storage: Storage, run: RunRecord) -> None:
    assert kept_comparison(laid(storage, run, None), storage)["truth"] is None
    other = storage.create_run(name="o", source="s", parameters={}, versions={})
    record = laid(storage, run, None, heard_by=other.id)
    with pytest.raises(StorageMissing, match=other.id):
        kept_comparison(record, storage)
    path = run_folder(storage, other.id) / "recording.mcap"
    path.write_bytes(b"x")
    told = kept_comparison(record, storage)["truth"]
    assert told["path"] == str(path.absolute())


def test_truth_on_the_runs_own_clock_needs_no_alignment(storage: Storage, run: RunRecord) -> None:
    storage.align_run(run.id, {"choices": {}})
    record = storage.get_run(run.id)
    assert record is not None
    assert record.aligned
    assert kept_comparison(record, storage)["alignment"] is None
