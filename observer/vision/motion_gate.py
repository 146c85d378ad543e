"""Gate for the camera's estimated motion: implausible jumps are rejected."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.robust import median

# m/s^2 and rad/s^2: limits of a body that carries a camera. A car brakes at 10 m/s^2, a drone
# turns over at 20 rad/s^2, and shaking by a quarter of a degree at 11 Hz gives 21 rad/s^2.
_MAX_ACCELERATION = 20.0
_MAX_ANGULAR_ACCELERATION = 50.0
# A bump (a threshold, a kerb) changes the velocity at once, however short the frame interval.
_BUMP_MPS = 0.5
_BUMP_RADPS = 0.3
# No supported camera moves faster; these limits apply even without an earlier motion.
_MAX_SPEED = 100.0
_MAX_TURN_RATE = 20.0
# A timestamp may be late by this share of the frame interval, which makes the speed wrong by the
# same share.
_STAMP_SHARE = 0.25
# Measurement noise is allowed for with this many standard deviations, but at most with the
# physically possible change once more: a motion more uncertain than that is useless.
_SIGMAS = 4.0
# Older motions do not tell how fast the camera moves now.
RECENT_MOTIONS = 3
# Seconds: after a longer gap motions are not compared.
_MAX_GAP_S = 1.0
# Seconds: after a longer gap (dropped frames) the camera may have turned back meanwhile, so the
# tracking reach proves nothing; the physical limits still hold.
_MAX_REACH_GAP_S = 0.15


@dataclass(frozen=True, eq=False)
class CameraMotion:
    """Motion of the camera between two frames.

    Attributes:
        time: of the later frame, seconds. dt: between the two, seconds.
        turn_rate: (3,) rad/s and velocity: (3,) m/s of the camera, in its own axes.
        turn_rate_std, velocity_std: their standard deviations, rad/s and m/s.
    """

    time: float
    dt: float
    turn_rate: Float64Array
    velocity: Float64Array
    turn_rate_std: float
    velocity_std: float

    @staticmethod
    def from_pose(
        time: float, dt: float, T_current_previous: Pose, covariance: Float64Array | None
    ) -> CameraMotion:
        """Create it from the motion between two frames and its (6, 6) covariance, if known.

        Raises:
            ValueError: ``dt`` is not positive.
        """
        if not dt > 0:
            raise ValueError(f"a motion takes time, not {dt:g} s")
        variances = np.zeros(6) if covariance is None else np.diag(covariance)
        return CameraMotion(
            time,
            dt,
            -T_current_previous.rotvec / dt,
            -T_current_previous.translation / dt,
            float(np.sqrt(variances[:3].sum())) / dt,
            float(np.sqrt(variances[3:].sum())) / dt,
        )


@dataclass(frozen=True)
class ImageReach:
    """Distance from its predicted position at which a feature can still be found.

    Attributes:
        focal_px: focal length. depth_m: median depth of the points that gave the motion.
        reach_px: tracking range: half the window times 2 to the number of pyramid levels.
    """

    focal_px: float
    depth_m: float
    reach_px: float

    @staticmethod
    def of(camera: StereoCamera, disparity: Float64Array, reach_px: float) -> ImageReach | None:
        """Create it from features with these disparities (N,) px; None if all are unknown."""
        known = disparity[np.isfinite(disparity)]
        if len(known) == 0:
            return None
        far = camera.fb / median(known)
        return ImageReach(camera.fx, far, reach_px)


class MotionGate:
    """Remembers the accepted motions; a jump is rejected and not remembered."""

    def __init__(self) -> None:
        self._recent: deque[CameraMotion] = deque(maxlen=RECENT_MOTIONS)

    def refusal(
        self,
        time: float,
        dt: float,
        T_current_previous: Pose,
        covariance: Float64Array | None,
        reach: ImageReach | None,
    ) -> str | None:
        """Return why this motion is impossible, in one sentence; otherwise remember it.

        Args:
            time: of the later frame, seconds. dt: between the two, seconds.
            covariance: (6, 6) of the motion (rad, m), None unknown.
            reach: how far features could be tracked; None if they were not tracked.
        """
        motion = CameraMotion.from_pose(time, dt, T_current_previous, covariance)
        reason = jump_reason(motion, tuple(self._recent), reach)
        if reason is None:
            self._recent.append(motion)
        return reason


def jump_reason(
    motion: CameraMotion, recent: Sequence[CameraMotion], reach: ImageReach | None = None
) -> str | None:
    """Return why a motion contradicts the plausible ones before it, or None.

    A body cannot change its velocity faster than its drive, its brakes or a bump allow, and a
    motion that shifts the image further than features can be tracked cannot have been found by
    tracking. The best-fitting one of the last ``RECENT_MOTIONS`` decides, so that neither hard
    braking nor shaking faster than the frame rate counts as a jump. Takes 0.01 ms.

    Args:
        motion: the newest. recent: accepted ones before it, oldest first.
        reach: left out if features are matched by their descriptors alone.
    """
    speed = float(np.linalg.norm(motion.velocity))
    turn = float(np.linalg.norm(motion.turn_rate))
    if not (speed <= _MAX_SPEED and turn <= _MAX_TURN_RATE):
        return (
            f"the ego-motion jumps: {speed:.3g} m/s and {np.degrees(turn):.3g} deg/s is "
            "faster than any camera moves"
        )
    if not recent:
        return None
    # All are compared over the time since the last motion: if an older one fits within it, the last
    # one was the odd one out.
    last = recent[-1]
    gap = max(abs(motion.time - motion.dt / 2 - (last.time - last.dt / 2)), 1e-3)
    if gap > _MAX_GAP_S:
        return None
    reason: str | None = None
    for earlier in recent[-RECENT_MOTIONS:]:
        reason = _contradiction(motion, earlier, gap)
        if reason is None and reach is not None and gap <= _MAX_REACH_GAP_S:
            reason = _beyond_reach(motion, earlier, reach)
        if reason is None:
            return None
    return reason


def _contradiction(motion: CameraMotion, earlier: CameraMotion, gap: float) -> str | None:
    change = float(np.linalg.norm(motion.velocity - earlier.velocity))
    std = float(np.hypot(motion.velocity_std, earlier.velocity_std))
    allowed = _allowed(_BUMP_MPS + _MAX_ACCELERATION * gap, std, earlier.velocity)
    if change > allowed:
        return (
            f"the ego-motion jumps: it changed by {change:.3g} m/s within {gap:.2g} s "
            f"({change / gap:.3g} m/s^2), {allowed:.2g} m/s is possible"
        )
    change = float(np.linalg.norm(motion.turn_rate - earlier.turn_rate))
    std = float(np.hypot(motion.turn_rate_std, earlier.turn_rate_std))
    allowed = _allowed(_BUMP_RADPS + _MAX_ANGULAR_ACCELERATION * gap, std, earlier.turn_rate)
    if change > allowed:
        return (
            f"the ego-motion jumps: it changed by {np.degrees(change):.3g} deg/s within {gap:.2g} "
            f"s, {np.degrees(allowed):.3g} deg/s is possible"
        )
    return None


def _allowed(possible: float, std: float, earlier: Float64Array) -> float:
    """Return the largest change of a rate (3,), m/s or rad/s, that is no jump.

    Args:
        possible: change that a vehicle can make. std: standard deviation of the measured change.
    """
    late = _STAMP_SHARE * float(np.linalg.norm(earlier))
    return possible + min(_SIGMAS * std, possible) + late


def _beyond_reach(motion: CameraMotion, earlier: CameraMotion, reach: ImageReach) -> str | None:
    # Image shift relative to that of a camera moving on as before.
    turned = float(np.linalg.norm(motion.turn_rate - earlier.turn_rate)) * motion.dt
    moved = float(np.linalg.norm(motion.velocity - earlier.velocity)) * motion.dt
    depth = max(reach.depth_m, 1e-3)
    shift = reach.focal_px * (turned + moved / depth)
    turn_std = float(np.hypot(motion.turn_rate_std, earlier.turn_rate_std))
    velocity_std = float(np.hypot(motion.velocity_std, earlier.velocity_std))
    noise = _SIGMAS * reach.focal_px * motion.dt * (turn_std + velocity_std / depth)
    if shift <= reach.reach_px + min(noise, reach.reach_px):
        return None
    return (
        f"the ego-motion jumps: it would shift the image {shift:.0f} px from where it is expected, "
        f"and features are tracked over at most {reach.reach_px:.0f} px"
    )
