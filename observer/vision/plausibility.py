"""Whether an estimated motion of the camera can be true, in the light of those before it."""

from __future__ import annotations

from collections import deque

from observer.geometry import Float64Array, Pose
from observer.vision.motion_gate import RECENT_MOTIONS, CameraMotion, ImageReach, jump_reason


class PlausibleMotions:
    """Remembers the motions that were accepted; a jump is refused and not remembered."""

    def __init__(self) -> None:
        self._recent: deque[CameraMotion] = deque(maxlen=RECENT_MOTIONS)

    def clear(self) -> None:
        """Forget all motions."""
        self._recent.clear()

    def refusal(
        self,
        time: float,
        dt: float,
        T_current_previous: Pose,
        covariance: Float64Array | None,
        reach: ImageReach | None,
    ) -> str | None:
        """Why this motion cannot be true, in one sentence, or None; then it is remembered.

        Args:
            time: of the later frame, seconds. dt: between the two, seconds.
            covariance: (6, 6) of the motion (rad, m), None unknown.
            reach: how far features could be followed; None where they were not followed.
        """
        motion = CameraMotion.from_pose(time, dt, T_current_previous, covariance)
        reason = jump_reason(motion, tuple(self._recent), reach)
        if reason is None:
            self._recent.append(motion)
        return reason
