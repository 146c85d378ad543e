from __future__ import annotations

import math
from dataclasses import replace

import pytest

from observer.mount import CameraMount
from observer.rig.applied import mount_for
from observer.rig.rig import Rig, RigMount, RigValue
from observer.sources.contract import SourceInfo

TYPED = Rig(RigMount(height_m=RigValue(0.5), tilt_deg=RigValue(10.0)), calibration="abc")


def source(kind: str, live: bool = False, own: bool = False) -> SourceInfo:
    info = SourceInfo(f"{kind}:x", kind, 640, 480, 30.0, None, live=live)
    if not own:
        return info
    return replace(
        info, mount_height_m=0.4, mount_tilt_rad=0.1, mount_forward_m=0.05, mount_left_m=0.06
    )


@pytest.mark.parametrize(
    ("kind", "live"), [("camera", True), ("network", True), ("recording", False)]
)
def test_live_cameras_and_recordings_use_the_rig(kind: str, live: bool) -> None:
    mount = mount_for(source(kind, live), TYPED)
    assert mount is not None
    assert (mount.height_m, mount.forward_m) == (0.5, None)
    assert mount_for(source(kind, live), None) is None
    assert mount_for(source(kind, live), Rig()) is None


def test_source_values_replace_unknown_rig_values() -> None:
    mount = mount_for(source("camera", live=True, own=True), TYPED)
    assert mount == CameraMount(0.5, math.radians(10), 0.05, 0.06)
    only_roll = Rig(RigMount(roll_deg=RigValue(3.0)))
    rolled = mount_for(source("camera", live=True, own=True), only_roll)
    assert rolled is not None
    assert (rolled.height_m, rolled.tilt_rad) == (0.4, pytest.approx(0.1))
    assert rolled.roll_rad == pytest.approx(math.radians(3))


@pytest.mark.parametrize("kind", ["simulated", "coppeliasim"])
def test_simulated_sources_keep_their_mount_unless_the_rig_applies_to_them(kind: str) -> None:
    info = source(kind, live=kind == "coppeliasim", own=True)
    assert mount_for(info, TYPED) == info.mount
    mount = mount_for(info, replace(TYPED, for_simulated=True))
    assert mount is not None
    assert mount.height_m == 0.5


@pytest.mark.parametrize("kind", ["stereo folder", "KITTI raw", "video"])
def test_files_use_the_rig_only_with_its_calibration(kind: str) -> None:
    assert mount_for(source(kind), TYPED) is None
    assert mount_for(source(kind), TYPED, "other") is None
    mount = mount_for(source(kind), TYPED, "abc")
    assert mount is not None
    assert mount.height_m == 0.5
    assert mount_for(source(kind), replace(TYPED, calibration=None), None) is None
