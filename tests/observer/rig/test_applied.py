from __future__ import annotations

import math
from dataclasses import replace

import pytest

from observer.geometry import Pose
from observer.mount import CameraMount
from observer.rig.applied import mount_for, with_drive, with_floor
from observer.rig.drive_estimate import DriveEstimate
from observer.rig.estimates import Estimated
from observer.rig.ground_estimate import FloorEstimate
from observer.rig.rig import Rig, RigMount, RigValue
from observer.rig.rig_file import read_rig, rig_text
from observer.sources.contract import SourceInfo

FLOOR = FloorEstimate(
    Estimated(0.41, 0.004), Estimated(math.radians(5), 0.002), Estimated(0.01, 0.003),
    0.5, 3, 0, "",
)  # fmt: skip
DRIVE = DriveEstimate(
    Estimated(0.05, 0.004), Estimated(0.06, 0.004), Estimated(0.07, 0.003),
    Estimated(0.2, 0.002), Estimated(0.3, 0.002), None, None, 1.0, 2.0, (), "",
)  # fmt: skip
TYPED = Rig(RigMount(height_m=RigValue(0.5), tilt_deg=RigValue(10.0)), calibration="abc")


def source(kind: str, live: bool = False, own: bool = False) -> SourceInfo:
    info = SourceInfo(f"{kind}:x", kind, 640, 480, 30.0, None, live=live)
    if not own:
        return info
    return replace(
        info, mount_height_m=0.4, mount_tilt_rad=0.1, mount_forward_m=0.05, mount_left_m=0.06
    )


def test_the_floor_fills_in_height_tilt_and_roll_with_their_uncertainty() -> None:
    rig = with_floor(Rig(), FLOOR, "c0ffee")
    assert rig.mount.height_m == RigValue(0.41, 0.004)
    assert rig.mount.tilt_deg is not None
    assert rig.mount.tilt_deg.value == pytest.approx(5)
    assert rig.mount.tilt_deg.sigma == pytest.approx(math.degrees(0.002))
    assert rig.calibration == "c0ffee"
    assert rig.mount.pan_deg is None


def test_what_a_person_typed_stays_unless_asked() -> None:
    kept = with_floor(TYPED, FLOOR)
    assert kept.mount.height_m == RigValue(0.5)
    assert kept.mount.roll_deg is not None
    assert kept.calibration == "abc"
    replaced = with_floor(TYPED, FLOOR, over_typed=True)
    assert replaced.mount.height_m == RigValue(0.41, 0.004)


def test_an_estimate_gives_way_to_a_newer_one() -> None:
    newer = replace(FLOOR, height_m=Estimated(0.45, 0.01))
    assert with_floor(with_floor(Rig(), FLOOR), newer).mount.height_m == RigValue(0.45, 0.01)


def test_a_drive_fills_in_the_offset_and_leaves_the_floors_tilt() -> None:
    rig = with_drive(with_floor(Rig(), FLOOR), DRIVE)
    assert rig.mount.forward_m == RigValue(0.05, 0.004)
    assert rig.mount.tilt_deg is not None
    assert rig.mount.tilt_deg.value == pytest.approx(5)
    alone = with_drive(Rig(), DRIVE)
    assert alone.mount.tilt_deg is not None
    assert alone.mount.tilt_deg.value == pytest.approx(math.degrees(0.2))


def test_what_a_drive_has_not_told_stays_as_it_was() -> None:
    before = Rig(RigMount(forward_m=RigValue(0.3, 0.1), pan_deg=RigValue(2.0, 0.1)))
    unknown = replace(DRIVE, forward_m=None, pan_rad=None)
    rig = with_drive(before, unknown)
    assert (rig.mount.forward_m, rig.mount.pan_deg) == (before.mount.forward_m, RigValue(2.0, 0.1))


def test_estimates_survive_the_file() -> None:
    rig = with_drive(with_floor(Rig(T_body_base={"amigo": Pose.identity()}), FLOOR), DRIVE)
    assert read_rig(rig_text(rig), "rig.yaml").mount == rig.mount


@pytest.mark.parametrize(
    ("kind", "live"), [("camera", True), ("network", True), ("recording", False)]
)
def test_live_cameras_and_recordings_are_the_rigs(kind: str, live: bool) -> None:
    mount = mount_for(source(kind, live), TYPED)
    assert mount is not None
    assert (mount.height_m, mount.forward_m) == (0.5, None)
    assert mount_for(source(kind, live), None) is None
    assert mount_for(source(kind, live), Rig()) is None


def test_the_sources_own_values_stand_in_for_those_the_rig_does_not_know() -> None:
    mount = mount_for(source("camera", live=True, own=True), TYPED)
    assert mount == CameraMount(0.5, math.radians(10), 0.05, 0.06)
    only_roll = Rig(RigMount(roll_deg=RigValue(3.0)))
    rolled = mount_for(source("camera", live=True, own=True), only_roll)
    assert rolled is not None
    assert (rolled.height_m, rolled.tilt_rad) == (0.4, pytest.approx(0.1))
    assert rolled.roll_rad == pytest.approx(math.radians(3))


@pytest.mark.parametrize("kind", ["simulated", "coppeliasim"])
def test_simulated_sources_keep_their_own_unless_the_rig_says_otherwise(kind: str) -> None:
    info = source(kind, live=kind == "coppeliasim", own=True)
    assert mount_for(info, TYPED) == info.mount
    mount = mount_for(info, replace(TYPED, for_simulated=True))
    assert mount is not None
    assert mount.height_m == 0.5


@pytest.mark.parametrize("kind", ["stereo folder", "KITTI raw", "video"])
def test_files_are_the_rigs_only_with_its_own_calibration(kind: str) -> None:
    assert mount_for(source(kind), TYPED) is None
    assert mount_for(source(kind), TYPED, "other") is None
    mount = mount_for(source(kind), TYPED, "abc")
    assert mount is not None
    assert mount.height_m == 0.5
    assert mount_for(source(kind), replace(TYPED, calibration=None), None) is None
