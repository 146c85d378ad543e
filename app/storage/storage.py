"""``Storage``: everything that the server keeps, behind one object."""

from __future__ import annotations

from app.storage.calibrations import CalibrationTables
from app.storage.parameters import ParameterTables
from app.storage.runs import RunTables
from app.storage.settings import SettingTables


class Storage(RunTables, ParameterTables, CalibrationTables, SettingTables):
    """One database with all its tables; thread-safe, synchronous.

    ``open`` (or ``with``) before use, ``close`` at the end; see ``Database`` for the arguments.
    Each part of the interface stands in the class of its tables. Every method raises
    ``StorageBusy``, ``StorageFull`` or another ``StorageError``; a write that raised wrote nothing.
    """
