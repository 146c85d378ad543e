"""Calibrations belong to cameras: found again by them, and a difference is reported."""

from __future__ import annotations

from typing import Literal

import pytest

from app.contract.events import EngineState, StateEvent
from app.contract.status import LiveCamera, LiveStatus
from app.server.errors import FieldError
from app.server.source.camera_match import calibration_of_cameras, camera_match_warnings
from app.server.source.chosen_source import choose_source
from app.storage import CalibrationRecord, Storage
from observer.recording.run_folder import RECORDING
from observer.sources.contract import SourceInfo

from ...planted_runs import run_folder

LEFT, RIGHT = "http://10.0.0.1/v", "http://10.0.0.2/v"
SOURCE = f"http://me:secret@10.0.0.1/v,{RIGHT}"


@pytest.fixture
def opened(storage: Storage) -> Storage:
    storage.open()
    return storage


def kept(storage: Storage, text: str, *devices: str, focus: str = "0") -> CalibrationRecord:
    settings = [{"size": "640x480", "focus": focus} for _ in devices]
    info = {"bound": {"source": "x", "devices": list(devices), "settings": settings}}
    return storage.save_calibration(text, name=text, info=info)


def state(*devices: str, focus: str = "0", live: bool = True) -> StateEvent:
    settings = {"size": "640x480", "focus": focus}
    sides: tuple[Literal["left", "right"], ...] = ("left", "right")
    cameras = [LiveCamera(side, "x", "open", None, settings, []) for side in sides]
    source = SourceInfo("x", "camera", 640, 480, 15.0, None, live=True, devices=devices)
    return StateEvent(
        EngineState.PREVIEW,
        None,
        source=source,
        live=LiveStatus(cameras, 0, 0, None, None, 0, [], None, None) if live else None,
    )


def test_the_newest_calibration_of_the_named_cameras_is_used(opened: Storage) -> None:
    kept(opened, "older", LEFT, RIGHT)
    newer = kept(opened, "newer", LEFT, RIGHT)
    kept(opened, "others", LEFT, "http://10.0.0.3/v")
    kept(opened, "swapped", RIGHT, LEFT)
    opened.save_calibration("of nobody", name="of nobody")
    found = calibration_of_cameras(opened, SOURCE)
    assert found is not None
    assert found.id == newer.id
    assert choose_source(opened, SOURCE, None).calibration == found
    # Other sources do not get the calibration of these cameras.
    for other in ("simulated:lab", "video:a.mp4,b.mp4", "/a/folder", "camera:7,8"):
        assert choose_source(opened, other, None).calibration is None


def test_other_or_swapped_cameras_and_focus_changes_give_warnings(opened: Storage) -> None:
    record = kept(opened, "stereo.yaml", LEFT, RIGHT)
    assert camera_match_warnings(state(LEFT, RIGHT), record) == []
    (swapped,) = camera_match_warnings(state(RIGHT, LEFT), record)
    assert "left and right swapped" in swapped
    (other,) = camera_match_warnings(state(LEFT, "http://10.0.0.3/v"), record)
    assert "made with other cameras" in other
    assert LEFT in other
    focus = camera_match_warnings(state(LEFT, RIGHT, focus="35"), record)
    assert len(focus) == 2
    assert "focus 0 of the left camera, which is now 35" in focus[0]


def test_unbound_calibrations_give_no_warnings(opened: Storage) -> None:
    record = kept(opened, "stereo.yaml", LEFT, RIGHT)
    unbound = opened.save_calibration("uploaded", name="uploaded")
    assert camera_match_warnings(state(LEFT, RIGHT), None) == []
    assert camera_match_warnings(state(LEFT, RIGHT), unbound) == []
    assert camera_match_warnings(state(LEFT, RIGHT, live=False), record) == []


def test_a_recorded_run_is_a_source_by_its_id(opened: Storage) -> None:
    run = opened.create_run(name="a", source="b", parameters={}, versions={})
    with pytest.raises(FieldError, match=r"was not recorded|no run"):
        choose_source(opened, f"run:{run.id}", None)
    recording = run_folder(opened, run.id) / RECORDING
    recording.touch()
    assert choose_source(opened, f"run:{run.id}", None).source == str(recording.absolute())
