from __future__ import annotations

import hashlib
from collections.abc import Callable

import pytest

from app.storage import RunState, Storage, StorageMissing
from observer.calibration.formats.opencv_file import calibration_id

TEXT = "%YAML:1.0\n---\nimage_width: 512 # Größe\n"


def test_a_calibration_is_identified_by_its_content(opened: Callable[[], Storage]) -> None:
    with opened() as storage:
        made = storage.save_calibration(TEXT, name="lab.yaml", info={"width": 512})
        assert made.id == hashlib.sha256(TEXT.encode()).hexdigest() == calibration_id(TEXT)
        again = storage.save_calibration(TEXT, name="renamed.yaml")
        assert (again.id, again.created_at, again.info) == (made.id, made.created_at, made.info)
        storage.save_calibration(TEXT + "\n", name="other.yaml")
    with opened() as storage:
        assert storage.get_calibration(made.id) == again
        assert [each.name for each in storage.list_calibrations()] == [
            "other.yaml",
            "renamed.yaml",
        ]


def test_a_calibration_can_be_activated_and_deactivated(storage: Storage) -> None:
    made = storage.save_calibration(TEXT, name="lab.yaml")
    assert storage.active_calibration() is None
    storage.activate_calibration(made.id)
    assert storage.active_calibration() == made
    with pytest.raises(StorageMissing, match="no calibration"):
        storage.activate_calibration("0" * 64)
    assert storage.active_calibration() == made
    storage.activate_calibration(None)
    assert storage.active_calibration() is None


def test_deleting_the_active_one_deactivates_it(storage: Storage) -> None:
    made = storage.save_calibration(TEXT, name="lab.yaml")
    storage.activate_calibration(made.id)
    assert storage.delete_calibration(made.id) is True
    assert storage.active_calibration() is None
    assert storage.get_calibration(made.id) is None
    assert storage.delete_calibration(made.id) is False


def test_a_run_keeps_the_text_of_a_deleted_calibration(storage: Storage) -> None:
    made = storage.save_calibration(TEXT, name="lab.yaml")
    run = storage.create_run(
        name="r", source="s", parameters={}, versions={}, calibration_id=made.id
    )
    storage.update_run(run.id, state=RunState.FINISHED)
    assert storage.delete_calibration(made.id) is True
    assert storage.list_calibrations() == []
    kept = storage.get_calibration(made.id)
    assert kept is not None
    assert kept.text == TEXT
    assert storage.delete_calibration(made.id) is False
    # Uploaded again, it is back on the list.
    assert storage.save_calibration(TEXT, name="lab.yaml").listed is True


def test_a_sources_own_calibration_is_stored_unlisted(storage: Storage) -> None:
    hidden = storage.save_calibration(TEXT, name="of kitti", listed=False)
    assert storage.list_calibrations() == []
    assert storage.get_calibration(hidden.id) == hidden
    storage.save_calibration(TEXT, name="mine.yaml")
    storage.save_calibration(TEXT, name="of kitti", listed=False)
    assert [each.name for each in storage.list_calibrations()] == ["mine.yaml"]
