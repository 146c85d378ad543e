"""The memory of camera motions by which jumps are refused."""

from __future__ import annotations

import numpy as np

from observer.geometry import Pose
from observer.vision.motion_gate import RECENT_MOTIONS, ImageReach, MotionGate

DT = 1 / 15
COVARIANCE = np.diag([1e-7] * 3 + [1e-6] * 3)
# Points at 2 m can be tracked over at most 60 px.
REACH = ImageReach(focal_px=443.0, depth_m=2.0, reach_px=60.0)


def ahead(speed: float) -> Pose:
    """The motion in one frame of a camera that drives straight ahead at ``speed`` m/s."""
    return Pose(np.eye(3), np.array([0.0, 0.0, -speed * DT]))


class Drive:
    """Feeds the gate frame by frame."""

    def __init__(self) -> None:
        self.motions = MotionGate()
        self._time = 0.0

    def goes(self, speed: float, reach: ImageReach | None = None) -> str | None:
        self._time += DT
        return self.motions.refusal(self._time, DT, ahead(speed), COVARIANCE, reach)


def test_steady_driving_is_never_refused() -> None:
    drive = Drive()
    assert [drive.goes(0.3, REACH) for _ in range(20)] == [None] * 20


def test_jump_is_refused_with_its_figures() -> None:
    drive = Drive()
    for _ in range(3):
        assert drive.goes(0.3) is None
    reason = drive.goes(9.0)
    assert reason is not None
    assert "jumps" in reason
    assert "8.7 m/s" in reason


def test_refused_motion_is_not_remembered() -> None:
    """Otherwise the first jump would confirm a second one of the same kind."""
    drive = Drive()
    for _ in range(3):
        drive.goes(0.3)
    for _ in range(RECENT_MOTIONS + 1):
        assert drive.goes(9.0) is not None
    assert drive.goes(0.3) is None


def test_only_impossible_motion_is_refused_without_history() -> None:
    assert Drive().goes(9.0) is None
    assert Drive().goes(150.0) is not None


def test_new_gate_has_no_history() -> None:
    drive = Drive()
    for _ in range(3):
        drive.goes(0.3)
    assert drive.goes(9.0) is not None
    drive.motions = MotionGate()
    assert drive.goes(9.0) is None
    # The next motion is compared with the accepted one.
    assert drive.goes(9.1) is None
    assert drive.goes(0.3) is not None


def test_old_accepted_motions_are_forgotten() -> None:
    drive = Drive()
    drive.goes(0.0)
    speed = 0.0
    while speed < 9.0:
        speed += 1.0
        assert drive.goes(speed) is None
    for _ in range(RECENT_MOTIONS):
        assert drive.goes(speed) is None
    assert drive.goes(0.0) is not None


def test_motion_beyond_the_image_reach_is_refused() -> None:
    """A speed change of 1.4 m/s is possible, but nearby points would move too far in the image."""
    near = ImageReach(focal_px=443.0, depth_m=0.4, reach_px=60.0)
    for reach, refused in ((None, False), (REACH, False), (near, True)):
        drive = Drive()
        for _ in range(3):
            assert drive.goes(0.2, reach) is None
        assert (drive.goes(1.6, reach) is not None) == refused
