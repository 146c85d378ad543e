"""Ground truth stored with a run, in the form that commands take."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from app.contract.truths import TruthReading
from app.contract.values import JsonObject
from app.storage.errors import StorageMissing
from app.storage.records import RunRecord
from app.storage.truths import TruthTables
from observer.recording.run_folder import RECORDING

_FOUND = "time"


@dataclass(frozen=True)
class StoredTruth:
    """Truth file to compare a run with; ``name`` is for people."""

    path: Path
    name: str
    reading: TruthReading

    def as_dict(self) -> JsonObject:
        """Return the plain values of an ``app.reports.comparison.TruthFile``."""
        return {"path": str(self.path.absolute()), "name": self.name, **vars(self.reading)}


def kept_comparison(record: RunRecord, storage: TruthTables) -> JsonObject:
    """Return the ground truth that a run is aligned with; the run must have one.

    The result fits ``app.reports.comparison.Comparison.of_dict``.

    Raises:
        StorageMissing: the truth's file is gone.
    """
    kept = record.alignment
    assert kept is not None
    truth = comparison_truth(storage, record.truth_id, kept)
    return {
        # Truth on the run's own clock needed no alignment in time.
        "alignment": kept if _FOUND in kept else None,
        "truth": None if truth is None else truth.as_dict(),
    }


def comparison_truth(
    storage: TruthTables, truth_id: str | None, kept: JsonObject
) -> StoredTruth | None:
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
        told = kept.get("reading") or (record.info.get("reading") if record else None) or {}
        name = path.name if record is None else record.name
        return StoredTruth(path, name, TruthReading(told.get("rate_hz"), told.get("angles")))
    other = kept.get("heard_by")
    if other is None:
        return None
    path = storage.folder.run(str(other)) / RECORDING
    if not path.is_file():
        raise StorageMissing(
            f"the run {other}, whose motion capture this run is compared with, no longer exists; "
            "upload a ground-truth file"
        )
    return StoredTruth(path, "motion capture received live", TruthReading(None, None))
