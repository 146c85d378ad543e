"""Local maps of a recording by frame: which one applied, and the robot's place in it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from operator import itemgetter

from observer.geometry import Pose
from observer.jsonl import line_pose
from observer.mount import CameraMount
from observer.occupancy import HELD_S, OccupancyMap
from observer.recording.payloads import RecordedFrame
from observer.recording.reader import Recording


@dataclass(frozen=True)
class MapInForce:
    """A map, and the frames at which it was the newest one.

    Attributes:
        positions: of these frames, from 0; the first one is that of the map.
        T_world_base: the robot's pose at each of them, where known.
    """

    map: OccupancyMap
    positions: range
    T_world_base: Mapping[int, Pose]

    def at(self, position: int) -> OccupancyMap | None:
        """Return the map with the robot's place at a frame; None where that is unknown."""
        begin, now = (self.T_world_base.get(k) for k in (self.positions.start, position))
        if begin is None or now is None:
            return None
        x, y, yaw = self.map.robot
        T_odometry_base = Pose.from_rotvec([0.0, 0.0, yaw], [x, y, 0.0]) @ begin.inverse() @ now
        ahead = T_odometry_base.rotate([1.0, 0.0, 0.0])
        place = T_odometry_base.translation
        robot = float(place[0]), float(place[1]), math.atan2(float(ahead[1]), float(ahead[0]))
        return replace(self.map, robot=robot)


def maps_in_force(recording: Recording) -> tuple[MapInForce, ...]:
    """Return the maps of a recording, in order; fast if there are none.

    Raises:
        SourceError: the recording is damaged.
    """
    maps, frames = list(recording.local_maps()), recording.frames
    mount = recording.facts.camera_mount() if maps else None
    if mount is None:
        return ()
    # Keyed by reception time, because frame numbers may repeat in a recording.
    places = {frame.received: position for position, frame in enumerate(frames)}
    begins = [(places[m.map.received], m.map) for m in maps if m.map.received in places]
    begins.sort(key=itemgetter(0))
    poses = list(_poses(recording, mount))
    found = []
    newer = [begin for begin, _ in begins[1:]]
    for (begin, one), after in zip(begins, [*newer, len(frames)], strict=False):
        end = begin + 1
        while end < after and _goes_on(frames[end], frames[begin]):
            end += 1
        known = {k: pose for k in range(begin, end) if (pose := poses[k]) is not None}
        found.append(MapInForce(one, range(begin, end), known))
    return tuple(found)


def maps_by_frame(recording: Recording) -> dict[int, OccupancyMap]:
    """Return the map valid at each frame, by position, with the robot's place at that frame."""
    return {
        position: placed
        for one in maps_in_force(recording)
        for position in one.positions
        if (placed := one.at(position)) is not None
    }


def _goes_on(frame: RecordedFrame, begin: RecordedFrame) -> bool:
    """Return whether a frame's map is still valid at a later frame, if there is no newer map."""
    return frame.begins is None and frame.received - begin.received <= HELD_S


def _poses(recording: Recording, mount: CameraMount) -> Iterator[Pose | None]:
    """Yield ``T_world_base`` of each frame; None where it is unknown."""
    T_camera_base = mount.T_base_camera.inverse()
    try:
        lines = dict(recording.positioned_lines())
    except (KeyError, TypeError):
        # They are not in the format that this program writes.
        lines = {}
    for position in range(len(recording.frames)):
        line = lines.get(position)
        try:
            # Without a line, the frame was not observed.
            pose = None if line is None else line_pose(line)
        except (KeyError, TypeError, ValueError):
            pose = None
        yield None if pose is None else pose @ T_camera_base
