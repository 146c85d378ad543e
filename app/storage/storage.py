"""``Storage``: all stored data behind one object."""

from __future__ import annotations

from datetime import timedelta

from app.storage.calibrations import CalibrationTables
from app.storage.parameters import ParameterTables
from app.storage.runs import UNDO, RunTables
from app.storage.settings import SettingTables
from app.storage.speeds import SpeedTables
from app.storage.truths import TruthTables


class Storage(
    RunTables, SpeedTables, TruthTables, ParameterTables, CalibrationTables, SettingTables
):
    """Database with all its tables, and the data folder beside it; thread-safe, synchronous.

    ``open`` (or ``with``) before use, ``close`` at the end; see ``Database`` for the arguments.
    Each part of the interface is in the class of its tables. Every method raises
    ``StorageBusy``, ``StorageFull`` or another ``StorageError``; a failed write wrote nothing.
    """

    def purge(self, older_than: timedelta = UNDO) -> list[str]:
        """Permanently delete what was discarded long enough ago; return the ids of its runs."""
        gone = self.purge_runs(older_than)
        self.purge_truths()
        return gone
