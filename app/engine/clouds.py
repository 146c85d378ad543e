"""The dense cloud for the 3D scene: bounded in points and in rate."""

from __future__ import annotations

from collections import deque
from typing import Any

from app.engine.watched import Observed
from observer.geometry import Pose
from observer.stages.stereo import point_cloud
from observer.types import Image

# On a link of 20 Mbit/s this many points ten times a second lag 75 ms, 50000 lag seconds.
MAX_POINTS = 20_000
MIN_INTERVAL_S = 0.1
# The longest distance of a pair's frames, and a few more for frames that were left out.
_REMEMBERED = 16


class RateLimit:
    """At most one per ``interval_s`` on average, whatever rhythm the frames have."""

    def __init__(self, interval_s: float) -> None:
        self._interval = interval_s
        self._next: float | None = None

    def allows(self, now: float) -> bool:
        if self._next is not None and now < self._next:
            return False
        late = self._next is None or now - self._next > self._interval
        self._next = (now if late or self._next is None else self._next) + self._interval
        return True


class CloudMaker:
    """Turns an observed frame's disparity into a cloud with the pose that belongs to it.

    The disparity is that of the pair at t, a frame before the newest one, so the pose at t is
    remembered until its cloud is made.
    """

    def __init__(self) -> None:
        self._seen: deque[tuple[Image, dict[str, Any]]] = deque(maxlen=_REMEMBERED)

    def remember(self, observed: Observed) -> None:
        """Keep the frame's pose for the cloud that a later frame brings."""
        observation = observed.observation
        left = observed.trace.get("left")
        if left is not None:
            instant = {
                "frame": observation.frame,
                "time": observation.time,
                "received": observation.received,
                "segment": observation.segment,
                "T_world_camera": _listed(observation.T_world_camera),
            }
            self._seen.append((left, instant))

    def make(self, observed: Observed) -> tuple[dict[str, Any], list[bytes]] | None:
        """Header and payload as the cloud slot carries them; None without a disparity.

        The payload is points (N, 3) float32, metres, in the camera frame of the header's frame,
        then colours (N, 3) uint8 RGB.
        """
        trace = observed.trace
        disparity, time = trace.get("disparity"), trace.get("previous_time")
        seen = next((seen for seen in self._seen if seen[1]["time"] == time), None)
        if disparity is None or seen is None:
            return None
        image, instant = seen
        points, colors = point_cloud(
            disparity, image, observed.camera, observed.parameters.stereo, MAX_POINTS
        )
        header = {**instant, "count": len(points)}
        return header, [points.tobytes(), colors.tobytes()]


def _listed(pose: Pose | None) -> list[float] | None:
    return None if pose is None else [float(value) for value in pose.matrix.ravel()]
