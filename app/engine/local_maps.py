"""Local map that applies at each frame: from planning the way to a goal, or from the recording."""

from __future__ import annotations

from collections.abc import Mapping

from app.contract.events import LocalMapEvent
from observer.geometry import Pose
from observer.mount import CameraMount
from observer.occupancy import HELD_S, OccupancyMap

_NONE = LocalMapEvent(None, None)


class LocalMaps:
    """Tracks the local map of one source.

    Args:
        recorded: recorded maps by frame position; empty if there are none.
        mount: mount of the cameras; without it no map can be placed in the world.
    """

    def __init__(self, recorded: Mapping[int, OccupancyMap], mount: CameraMount | None) -> None:
        self._recorded = recorded
        self._T_camera_base = None if mount is None else mount.T_base_camera.inverse()
        self._sent = _NONE
        self._segment = 0

    def next_event(
        self,
        made: OccupancyMap | None,
        position: int,
        segment: int,
        received: float,
        T_world_camera: Pose | None,
    ) -> LocalMapEvent | None:
        """Return the event to send for the next frame; None if the map has not changed.

        Args:
            made: map planned from this frame, if any. position: of the frame within the source.
            received: reception of the frame, on the clock of ``OccupancyMap.received``.
        """
        new, sent = made or self._recorded.get(position), self._sent.map
        if new is None:
            goes_on = sent is not None and received - sent.received <= HELD_S
            if sent is None or (goes_on and segment == self._segment and not self._recorded):
                return None
            event = _NONE
        elif sent is not None and new.received == sent.received and segment == self._segment:
            # The same recorded map, at a later frame: only the robot's pose in it differs.
            return None
        else:
            event = self._placed(new, T_world_camera)
        if event.map is None and sent is None:
            return None
        self._sent, self._segment = event, segment
        return event

    def _placed(self, new: OccupancyMap, T_world_camera: Pose | None) -> LocalMapEvent:
        if T_world_camera is None or self._T_camera_base is None:
            return _NONE
        return LocalMapEvent(new, new.placed(T_world_camera @ self._T_camera_base))
