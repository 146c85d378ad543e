"""From estimates into the rig, and from the rig to the mount that a source is observed with."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from observer.mount import CameraMount
from observer.rig.drive_estimate import DriveEstimate
from observer.rig.estimates import Estimated
from observer.rig.ground_estimate import FloorEstimate
from observer.rig.rig import Rig, RigValue, camera_mount
from observer.sources.contract import SourceInfo

_SIMULATED = ("simulated", "coppeliasim")
_RECORDED = ("recording",)


def with_floor(
    rig: Rig, floor: FloorEstimate, calibration: str | None = None, *, over_typed: bool = False
) -> Rig:
    """The rig with height, tilt and roll by the floor.

    Args:
        calibration: id of the one that the floor was seen with; None leaves the rig's.
        over_typed: whether estimates also replace what a person typed.
    """
    found = {
        "height_m": _metres(floor.height_m),
        "tilt_deg": _degrees(floor.tilt_rad),
        "roll_deg": _degrees(floor.roll_rad),
    }
    return _with(rig, found, calibration, over_typed)


def with_drive(
    rig: Rig, drive: DriveEstimate, calibration: str | None = None, *, over_typed: bool = False
) -> Rig:
    """The rig with pan and offset by a drive; tilt and roll only where they were unknown.

    What the drive has not told yet stays as it is. Arguments as of ``with_floor``.

    Raises:
        InputError: the drive puts the camera further from the axle than a rig may be.
    """
    found = {}
    for key, length in (("forward_m", drive.forward_m), ("left_m", drive.left_m)):
        if length is not None:
            found[key] = _metres(length)
    if drive.pan_rad is not None:
        found["pan_deg"] = _degrees(drive.pan_rad)
    known = rig.mount.values()
    for key, angle in (("tilt_deg", drive.tilt_rad), ("roll_deg", drive.roll_rad)):
        if angle is not None and key not in known:
            found[key] = _degrees(angle)
    return _with(rig, found, calibration, over_typed)


def mount_for(
    info: SourceInfo, rig: Rig | None, calibration: str | None = None
) -> CameraMount | None:
    """Return the mount of a source's camera: by the rig where it is this source's, else its own.

    - Live cameras and recordings of runs are the rig's: its values win one by one, and the
      source's own, where it tells any, stand in for those that the rig does not know.
    - Simulated sources know their mount exactly and keep it, unless the rig says
      ``for_simulated``; then they are as live cameras.
    - Files (folders, data sets, videos) may come from any robot: they keep their own, unless they
      are observed with the very calibration that the rig was measured with.

    Args:
        calibration: id of the calibration in use, as ``Rig.calibration``; None where unknown.

    Returns:
        None where height or tilt is known to neither.
    """
    if rig is None or not _belongs(info, rig, calibration):
        return info.mount
    return camera_mount({**_own_values(info), **rig.mount.values()})


def _belongs(info: SourceInfo, rig: Rig, calibration: str | None) -> bool:
    if info.kind in _SIMULATED:
        return rig.for_simulated
    if info.live or info.kind in _RECORDED:
        return True
    return rig.calibration is not None and rig.calibration == calibration


def _own_values(info: SourceInfo) -> dict[str, RigValue]:
    tilt = info.mount_tilt_rad
    own = {
        "height_m": info.mount_height_m,
        "tilt_deg": None if tilt is None else math.degrees(tilt),
        "forward_m": info.mount_forward_m,
        "left_m": info.mount_left_m,
    }
    return {key: RigValue(value) for key, value in own.items() if value is not None}


def _with(
    rig: Rig, found: Mapping[str, RigValue], calibration: str | None, over_typed: bool
) -> Rig:
    known = rig.mount.values()
    kept = {
        key: value for key, value in known.items() if value.origin == "typed" and not over_typed
    }
    mount = replace(rig.mount, **{**found, **kept})
    return replace(rig, mount=mount, calibration=calibration or rig.calibration)


def _metres(length: Estimated) -> RigValue:
    return RigValue(length.value, length.sigma)


def _degrees(angle: Estimated) -> RigValue:
    return RigValue(angle.degrees.value, angle.degrees.sigma)
