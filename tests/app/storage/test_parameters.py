from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from app.storage import RunRecord, Storage, StorageExists
from app.storage.records import SavedParameters


def test_parameters_are_restored_unchanged(opened: Callable[[], Storage]) -> None:
    values: dict[str, Any] = {
        "ego_motion.ransac_threshold_px": 0.1 + 0.2,
        "features.detector": "fast",
        "a": None,
    }
    with opened() as storage:
        assert storage.load_parameters() is None
        storage.save_parameters(1, {"a": 1}, "paper")
        storage.save_parameters(2, values, None, "mine")
    with opened() as storage:
        assert storage.load_parameters() == SavedParameters(2, values, None, "mine")


def test_values_not_representable_in_json_are_refused(storage: Storage) -> None:
    storage.save_parameters(1, {"a": 1.0}, None)
    with pytest.raises(Exception, match="not JSON compliant"):
        storage.save_parameters(2, {"a": math.nan}, None)
    assert storage.load_parameters() == SavedParameters(1, {"a": 1.0}, None)


def test_revisions_inside_and_outside_runs_are_separate(storage: Storage, run: RunRecord) -> None:
    first = storage.record_parameter_revision(run.id, 10, 1, {"tracking.gate": 2.5})
    second = storage.record_parameter_revision(run.id, 11, 2, {"tracking.gate": 3.0})
    outside = storage.record_parameter_revision(None, None, 3, {"tracking.gate": 3.5})
    assert storage.parameter_revisions(run.id) == [first, second]
    assert storage.parameter_revisions(None) == [outside]


def test_preset_names_are_unique(storage: Storage) -> None:
    made = storage.save_preset("mine", {"a": 1}, help="for the corridor")
    assert storage.list_presets() == [made]
    with pytest.raises(StorageExists, match='"mine"'):
        storage.save_preset("mine", {"a": 2})
    assert storage.list_presets() == [made]
    replaced = storage.save_preset("mine", {"a": 2}, replace=True)
    assert replaced.values == {"a": 2}
    assert replaced.created_at == made.created_at
    storage.save_preset("before", {})
    assert [preset.name for preset in storage.list_presets()] == ["before", "mine"]
    assert storage.delete_preset("mine") is True
    assert storage.delete_preset("mine") is False
    assert [preset.name for preset in storage.list_presets()] == ["before"]


def test_settings_are_stored_and_replaced(storage: Storage) -> None:
    assert storage.get_setting("theme", "light") == "light"
    storage.set_setting("theme", {"name": "dark"})
    storage.set_setting("theme", {"name": "darker"})
    assert storage.get_setting("theme") == {"name": "darker"}
    storage.set_setting("theme", None)
    assert storage.get_setting("theme") is None


def test_values_stored_under_old_names_are_read_under_current_ones(
    storage: Storage, run: RunRecord
) -> None:
    old: dict[str, Any] = {
        "ego_motion.model": "one_camera",
        "following.growth_noise": 0.2,
        "tracking.gate": 1.0,
    }
    new = {
        "ego_motion.model": "monocular",
        "klt_tracking.scale_change_noise": 0.2,
        "tracking.gate": 1.0,
    }
    storage.save_parameters(1, old, "mine")
    storage.save_preset("mine", old)
    storage.record_parameter_revision(run.id, 10, 1, old)
    kept = storage.create_run(name="old", source="simulated:lab", parameters=old, versions={})
    found, (preset,) = storage.load_parameters(), storage.list_presets()
    assert found is not None
    assert found.values == preset.values == new
    assert storage.parameter_revisions(run.id)[0].difference == new
    record = storage.get_run(kept.id)
    assert record is not None
    assert record.parameters == new
