"""Ground truth stored with a run, in the form that commands take."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from app.storage.errors import StorageMissing
from app.storage.records import RunRecord
from app.storage.truths import TruthTables
from observer.recording.run_folder import RECORDING

_FOUND = "time"


def kept_comparison(record: RunRecord, storage: TruthTables) -> dict[str, Any]:
    """Return the ground truth that a run is aligned with; the run must have one.

    The result fits ``app.reports.comparison.Comparison.of_dict``.

    Raises:
        StorageMissing: the truth's file is gone.
    """
    kept = record.alignment
    assert kept is not None
    return {
        # Truth on the run's own clock needed no alignment in time.
        "alignment": kept if _FOUND in kept else None,
        "truth": comparison_truth(storage, record.truth_id, kept),
    }


def comparison_truth(
    storage: TruthTables, truth_id: str | None, kept: Mapping[str, Any]
) -> dict[str, Any] | None:
    """Return a truth file and the options to read it; None for truth received live by the run
    itself.

    Args:
        kept: data stored with the run: its ``reading`` (default: the one of the upload), and
            ``heard_by``, another run that received the motion capture live.

    Raises:
        StorageMissing: there is no such truth, or its file is gone.
    """
    if truth_id is not None:
        record = storage.get_truth(truth_id)
        path = storage.truth_file(truth_id)
        reading = kept.get("reading") or (record.info.get("reading") if record else None) or {}
        name = path.name if record is None else record.name
        return _file(str(path.absolute()), name, reading)
    other = kept.get("heard_by")
    if other is None:
        return None
    path = storage.folder.run(str(other)) / RECORDING
    if not path.is_file():
        raise StorageMissing(
            f"the run {other}, whose motion capture this run is compared with, no longer exists; "
            "upload a ground-truth file"
        )
    return _file(str(path.absolute()), "motion capture received live", {})


def _file(path: str, name: str, reading: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "path": path,
        "name": name,
        "rate_hz": reading.get("rate_hz"),
        "angles": reading.get("angles"),
    }
