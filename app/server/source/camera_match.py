"""Matching of calibrations to cameras: by device, and by comparing camera settings."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass

from app.contract.events import StateEvent
from app.contract.values import of_plain
from app.storage import CalibrationRecord, Storage
from observer.opening import live_devices

# Settings that move the lens or select the pixels: changing them invalidates the calibration.
_DECISIVE = ("focus", "size")


@dataclass(frozen=True)
class BoundCameras:
    """Cameras that a calibration was made with, and their settings then; empty if unknown."""

    devices: tuple[str, ...] = ()
    settings: tuple[Mapping[str, str], ...] = ()


def calibration_of_cameras(storage: Storage, source: str) -> CalibrationRecord | None:
    """Return the newest calibration made with the cameras that ``source`` names.

    Return None if the source is not live, or there is no such calibration.
    """
    devices = live_devices(source)
    if not devices:
        return None
    stored = storage.list_calibrations()
    return next((each for each in stored if bound_cameras(each).devices == devices), None)


def camera_match_warnings(state: StateEvent, calibration: CalibrationRecord | None) -> list[str]:
    """Return a sentence for each difference between the open cameras and the calibrated ones."""
    if calibration is None or state.live is None or state.source is None:
        return []
    cameras = bound_cameras(calibration)
    bound = cameras.devices
    if not bound:
        return []
    open_devices = state.source.devices
    name = calibration.name
    if open_devices == bound[::-1] != bound:
        return [
            f"the calibration {name} was made with left and right swapped: swap the cameras, or "
            "calibrate them in this order"
        ]
    if open_devices != bound:
        return [
            f"the calibration {name} was made with other cameras ({' and '.join(bound)}): connect "
            "those, or calibrate the present ones"
        ]
    warnings = []
    for before, camera in zip(cameras.settings, state.live.cameras, strict=False):
        now = camera.settings
        for key in _DECISIVE:
            if key in before and key in now and before[key] != now[key]:
                warnings.append(
                    f"the calibration {name} was made with {key} {before[key]} of the "
                    f"{camera.side} camera, which is now {now[key]}: change it back, or recalibrate"
                )
    return warnings


def bound_cameras(record: CalibrationRecord) -> BoundCameras:
    """Return the cameras of a calibration; none if the record was damaged by hand."""
    with contextlib.suppress(ValueError):
        return of_plain(BoundCameras, record.info.get("bound", {}))
    return BoundCameras()
