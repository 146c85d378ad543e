"""The truth that is kept with a run, as the text that commands take."""

from __future__ import annotations

from typing import Any

from app.storage.records import RunRecord
from app.storage.truths import TruthTables


def kept_comparison(record: RunRecord, storage: TruthTables) -> dict[str, Any]:
    """The truth that was laid over a run, which must have one.

    It is what ``app.reporting.comparison.Comparison.of_dict`` takes.

    Raises:
        StorageMissing: the truth's file is gone.
    """
    truth = None
    if record.truth_id is not None:
        kept = storage.get_truth(record.truth_id)
        path = storage.truth_file(record.truth_id)
        assert kept is not None
        reading = kept.info.get("reading", {})
        truth = {"path": str(path.absolute()), "name": kept.name, **reading}
    # What is on the run's own clock is kept with an empty alignment.
    return {"alignment": record.alignment or None, "truth": truth}
