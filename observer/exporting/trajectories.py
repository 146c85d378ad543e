"""Trajectories in the TUM format, for evo and other tools that compare trajectories.

One line per pose, ``t tx ty tz qx qy qz qw``: seconds on the source's clock, metres, and a unit
quaternion, in the world of one segment (the camera at its first frame: x right, y down, z forward).
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import TextIO

from observer.exporting.errors import ExportError
from observer.jsonl import OutlinedEntry
from observer.recording.reader import Recording

_UPRIGHT_WXYZ = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class WrittenTrajectory:
    """Summary of a written trajectory.

    Attributes:
        poses: number written. segment: whose world they are in. others: number of poses of other
            segments, which are left out because their worlds differ.
    """

    poses: int
    segment: int
    others: int


def write_tum(recording: Recording, file: TextIO, track: int | None = None) -> WrittenTrajectory:
    """Write the camera's trajectory, or an obstacle's, of the segment with the most poses.

    Args:
        track: number of an obstacle, whose centre is written; an unknown orientation is written as
            the identity. None: the left camera.

    Raises:
        ExportError: there is no such obstacle, or no pose is known.
    """
    poses: dict[int, list[str]] = defaultdict(list)
    for line in recording.lines():
        described: list[OutlinedEntry] = [o for o in line["obstacles"] if o["id"] == track]
        for each in [line["pose"]] if track is None else described:
            if each is not None and each["position"] is not None:
                wxyz = each["orientation_wxyz"] or _UPRIGHT_WXYZ
                numbers = (line["time"], *each["position"], *wxyz[1:], wxyz[0])
                poses[line["segment"]].append(" ".join(repr(float(n)) for n in numbers))
    if not poses:
        what = "no pose of the camera" if track is None else f"no obstacle {track}"
        raise ExportError(f"{what} is in this recording")
    segment = max(poses, key=lambda number: len(poses[number]))
    whose = "the left camera" if track is None else f"obstacle {track}"
    file.write(f"# {whose} in the world of segment {segment}\n# t tx ty tz qx qy qz qw\n")
    file.writelines(f"{pose}\n" for pose in poses[segment])
    count = len(poses[segment])
    return WrittenTrajectory(count, segment, sum(map(len, poses.values())) - count)
