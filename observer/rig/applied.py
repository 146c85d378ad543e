"""Choice of the camera mount to use for a source: the rig's or the source's own."""

from __future__ import annotations

import math

from observer.mount import CameraMount
from observer.rig.rig import Rig, RigValue, camera_mount
from observer.sources.contract import SIMULATED_KINDS, SourceInfo

_RECORDED = ("recording",)


def mount_for(
    info: SourceInfo, rig: Rig | None, calibration: str | None = None
) -> CameraMount | None:
    """Return the mount of a source's camera: the rig's if it applies to the source, else its own.

    - Live cameras and recordings of runs use the rig's: each value that it knows wins, and the
      source's own values, if any, fill in the rest.
    - Simulated sources know their mount exactly and keep it, unless the rig says
      ``for_simulated``; then they are treated like live cameras.
    - Files (folders, data sets, videos) may come from any robot: they keep their own, unless the
      calibration in use is the one that the rig was measured with.

    Args:
        calibration: id of the calibration in use, as ``Rig.calibration``; None where unknown.

    Returns:
        None if the height or the tilt is known from neither.
    """
    if rig is None or not _belongs(info, rig, calibration):
        return info.mount
    return camera_mount({**_own_values(info), **rig.mount.values()})


def _belongs(info: SourceInfo, rig: Rig, calibration: str | None) -> bool:
    if info.kind in SIMULATED_KINDS:
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
