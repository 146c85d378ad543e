"""What outlives the process: runs, speeds, parameters, presets, calibrations, settings.

``Storage`` is the only door. It is synchronous and thread-safe; the server calls it from worker
threads. SQLite (write-ahead log) in one file is the default, any SQLAlchemy URL may take its place.
"""

from __future__ import annotations

from app.storage.errors import (
    StorageBusy,
    StorageCorrupt,
    StorageError,
    StorageExists,
    StorageFull,
    StorageMissing,
)
from app.storage.records import (
    CalibrationRecord,
    IncidentRecord,
    ParameterRevision,
    PresetRecord,
    RunRecord,
    RunState,
    SavedParameters,
    SpeedRow,
    StopFigures,
    utc_now,
)
from app.storage.storage import Storage

__all__ = [
    "CalibrationRecord",
    "IncidentRecord",
    "ParameterRevision",
    "PresetRecord",
    "RunRecord",
    "RunState",
    "SavedParameters",
    "SpeedRow",
    "StopFigures",
    "Storage",
    "StorageBusy",
    "StorageCorrupt",
    "StorageError",
    "StorageExists",
    "StorageFull",
    "StorageMissing",
    "utc_now",
]
