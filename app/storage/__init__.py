"""Data that outlives the process: runs, speeds, parameters, presets, calibrations, truths,
settings.

``Storage`` is the only entry point. It is synchronous and thread-safe; the server calls it from
worker threads. The default is SQLite (write-ahead log) in one file; the URL of a PostgreSQL server
may replace it. Runs and truths have their files in the data folder.
"""

from __future__ import annotations

from app.storage.errors import (
    StorageBusy,
    StorageError,
    StorageExists,
    StorageFull,
    StorageMissing,
    StorageUnreadable,
)
from app.storage.folder import DataFolder
from app.storage.records import (
    CalibrationRecord,
    IncidentRecord,
    PresetRecord,
    RunRecord,
    RunState,
    SpeedRow,
    TruthRecord,
    utc_now,
)
from app.storage.runs import UNDO
from app.storage.storage import Storage

__all__ = [
    "UNDO",
    "CalibrationRecord",
    "DataFolder",
    "IncidentRecord",
    "PresetRecord",
    "RunRecord",
    "RunState",
    "SpeedRow",
    "Storage",
    "StorageBusy",
    "StorageError",
    "StorageExists",
    "StorageFull",
    "StorageMissing",
    "StorageUnreadable",
    "TruthRecord",
    "utc_now",
]
