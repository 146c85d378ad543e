"""Choice of the mount that a source is observed with: the rig's or its own."""

from __future__ import annotations

import math

from observer.mount import CameraMount
from observer.rig.rig import Rig, RigValue, camera_mount
from observer.sources.contract import SourceInfo

_SIMULATED = ("simulated", "coppeliasim")
_RECORDED = ("recording",)


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
