"""Incidents and measured stops in the database."""

from __future__ import annotations

from dataclasses import replace

import pytest

from app.contract.robots import StopMeasured
from app.storage import IncidentRecord, Storage, StorageMissing


def test_incidents_are_stored_with_their_run_and_deleted_with_it(storage: Storage) -> None:
    storage.open()
    record = storage.create_run(name="a", source="b", parameters={}, versions={})
    at = "2026-01-01T00:00:00.000+00:00"
    incident = IncidentRecord(record.id, at, None, "stop", "Stop.", 0.2)
    number = storage.append_incident(incident)
    assert storage.incidents(record.id) == [incident]
    known = StopMeasured(212.4, 603.1, 0.085, 0.25, 0.71)
    unknown = StopMeasured(None, None, None, None, None)
    storage.append_stop(number, "observer", known)
    storage.append_stop(number, "obstacle", unknown)
    stopped = replace(incident, stops={"observer": known, "obstacle": unknown})
    storage.append_incident(stopped)
    assert storage.incidents(record.id) == [stopped, stopped]
    with pytest.raises(StorageMissing):
        storage.append_incident(IncidentRecord("none", "t", None, "stop", "Stop.", None))
    assert storage.delete_run(record.id)
    assert storage.incidents(record.id) == []
    with pytest.raises(StorageMissing):
        storage.append_stop(number, "observer", known)
