"""Cameras of a calibration: finding them, and comparing their settings with the present ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from app.contract.events import StateEvent
from app.storage import CalibrationRecord, Storage
from observer.opening import live_devices

# Settings that move the lens or choose the pixels: another value makes it another camera.
_DECISIVE = ("focus", "size")


def calibration_of_cameras(storage: Storage, source: str) -> CalibrationRecord | None:
    """Return the newest calibration made with the cameras that ``source`` names.

    None if the source is not live, or has no such calibration.
    """
    devices = live_devices(source)
    if not devices:
        return None
    return next((each for each in storage.list_calibrations() if _devices(each) == devices), None)


def camera_match_warnings(state: StateEvent, calibration: CalibrationRecord | None) -> list[str]:
    """Return a sentence for each difference between the open cameras and the calibrated ones."""
    if calibration is None or state.live is None or state.source is None:
        return []
    bound = _devices(calibration)
    if not bound:
        return []
    open_devices = state.source.devices
    name = calibration.name
    if open_devices == bound[::-1] != bound:
        return [
            f"the calibration {name} was made with left and right the other way round: swap the "
            f"cameras, or calibrate them in this order"
        ]
    if open_devices != bound:
        return [
            f"the calibration {name} was made with other cameras ({' and '.join(bound)}): "
            f"calibrate these, or plug those in"
        ]
    settings: Sequence[Mapping[str, str]] = calibration.info["bound"].get("settings", ())
    warnings = []
    for before, camera in zip(settings, state.live.cameras, strict=False):
        now = camera.settings
        for key in _DECISIVE:
            if key in before and key in now and before[key] != now[key]:
                warnings.append(
                    f"the calibration {name} was made with {key} {before[key]} of the "
                    f"{camera.side} camera, which is {now[key]} now: set it back, or "
                    f"calibrate anew"
                )
    return warnings


def _devices(record: CalibrationRecord) -> tuple[str, ...]:
    return tuple(record.info.get("bound", {}).get("devices", ()))
