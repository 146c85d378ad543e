"""Data that outlives the process: runs, speeds, parameters, presets, calibrations, truths,
settings.

``Storage`` is the only entry point. It is synchronous and thread-safe; the server calls it from
worker threads. The default is SQLite (write-ahead log) in one file; the URL of a PostgreSQL server
may replace it. Runs and truths have their files in the data folder.
"""

from __future__ import annotations

from app.storage.errors import (
    StorageBusy,
    StorageCorrupt,
    StorageError,
    StorageExists,
    StorageFull,
    StorageMissing,
    StorageUnreachable,
)
from app.storage.folder import DataFolder, DiskUse
from app.storage.records import (
    CalibrationRecord,
    IncidentRecord,
    ParameterRevision,
    PresetRecord,
    RunPage,
    RunRecord,
    RunState,
    SavedParameters,
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
    "DiskUse",
    "IncidentRecord",
    "ParameterRevision",
    "PresetRecord",
    "RunPage",
    "RunRecord",
    "RunState",
    "SavedParameters",
    "SpeedRow",
    "Storage",
    "StorageBusy",
    "StorageCorrupt",
    "StorageError",
    "StorageExists",
    "StorageFull",
    "StorageMissing",
    "StorageUnreachable",
    "TruthRecord",
    "utc_now",
]
