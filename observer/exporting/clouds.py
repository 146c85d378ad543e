"""Point cloud of a frame, and its file format."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO, Literal

import numpy as np
from numpy.typing import NDArray

from observer.camera import as_gray
from observer.exporting.choices import CloudFrame
from observer.exporting.errors import ExportError
from observer.exporting.foxglove_messages import read_cloud
from observer.geometry import Pose
from observer.jsonl import line_pose
from observer.parameters import Parameters, StereoParameters
from observer.recording import topics
from observer.recording.reader import Recording
from observer.vision.rectification import Rectification
from observer.vision.stereo import disparity_map, point_cloud

# More than any screen shows; a 640x480 pair yields a third of it.
_MAX_POINTS = 1_000_000


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points (N, 3) float32, metres, with colours (N, 3) uint8, RGB.

    Attributes:
        frame: of the coordinates. source: ``recorded``, or ``computed`` from the images.
        index, time: of the frame that it belongs to.
    """

    points: NDArray[np.float32]
    colors: NDArray[np.uint8]
    frame: CloudFrame
    source: Literal["recorded", "computed"]
    index: int
    time: float


def cloud_at(recording: Recording, position: int, frame: CloudFrame = "camera") -> Cloud:
    """Return the cloud of a frame: as recorded, else by dense stereo from the images.

    Args:
        position: of the frame in the recording, from 0.
        frame: coordinate frame of the points; the world is that of the frame's segment.

    Raises:
        ExportError: there is no such frame, or the world is requested but its pose unknown.
        SourceError: neither a cloud nor images were recorded for it.
    """
    count = len(recording.frames)
    if not 0 <= position < count:
        raise ExportError(
            f"{recording.path.name} has no frame at position {position}; it has 0 to {count - 1}"
        )
    T_world_camera = _pose_at(recording, position) if frame == "world" else None
    found = _recorded(recording, position)
    points, colors = found or _computed(recording, position)
    if T_world_camera is not None:
        R, t = T_world_camera.rotation, T_world_camera.translation
        points = (points @ R.T + t).astype(np.float32)
    at = recording.frames[position]
    source: Literal["recorded", "computed"] = "computed" if found is None else "recorded"
    return Cloud(points, colors, frame, source, at.index, at.time)


def recorded_clouds(recording: Recording) -> Iterator[tuple[int, Cloud]]:
    """Yield the recorded clouds, in the camera frame, each with the position of its frame."""
    wall = recording.facts.anchor.wall_time_ns
    positions = {wall(frame.received): k for k, frame in enumerate(recording.frames)}
    for _, message in recording.messages(topics.CLOUD.name):
        recorded = read_cloud(message.data)
        position = positions.get(recorded.stamp_ns)
        if position is not None:
            at = recording.frames[position]
            yield (
                position,
                Cloud(recorded.points, recorded.colors, "camera", "recorded", at.index, at.time),
            )


def write_ply(cloud: Cloud, file: IO[bytes]) -> None:
    """Write a cloud as binary PLY, little endian: x y z in metres, red green blue.

    The format is that of Greg Turk, "The PLY Polygon File Format", 1994.
    """
    vertices = np.zeros(len(cloud.points), dtype=[("xyz", "<f4", 3), ("rgb", "u1", 3)])
    vertices["xyz"], vertices["rgb"] = cloud.points, cloud.colors
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment metres, {cloud.frame} frame, x right, y down, z forward of the "
        f"{'camera' if cloud.frame == 'camera' else 'first camera of the segment'}",
        f"comment frame {cloud.index}, {cloud.time!r} s, {cloud.source}",
        f"element vertex {len(vertices)}",
        *(f"property float {axis}" for axis in "xyz"),
        *(f"property uchar {color}" for color in ("red", "green", "blue")),
        "end_header\n",
    ]
    file.write("\n".join(header).encode("ascii"))
    file.write(vertices.tobytes())


def _pose_at(recording: Recording, position: int) -> Pose:
    line = next((line for at, line in recording.positioned_lines() if at == position), None)
    pose = None if line is None else line_pose(line)
    if pose is None:
        raise ExportError(
            f"the camera's pose at frame {recording.frames[position].index} is not known, so its "
            "cloud can only be given in the camera frame"
        )
    return pose


def _recorded(
    recording: Recording, position: int
) -> tuple[NDArray[np.float32], NDArray[np.uint8]] | None:
    for at, cloud in recorded_clouds(recording):
        if at == position:
            return cloud.points, cloud.colors
    return None


def _computed(recording: Recording, position: int) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    rectified = Rectification(recording.calibration())
    left, right = recording.pair(position)
    left, right = rectified.apply(left, right)
    parameters = _stereo_parameters(recording, position)
    disparity = disparity_map(as_gray(left), as_gray(right), parameters)
    return point_cloud(disparity, left, rectified.camera, parameters, _MAX_POINTS)


def _stereo_parameters(recording: Recording, position: int) -> StereoParameters:
    values = {}
    for begin, revision in recording.positioned_revisions:
        if begin <= position:
            values = revision.values
    return Parameters().changed(Parameters.own(values)).stereo
