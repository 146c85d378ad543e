"""Export of a run as a ROS 2 bag: a folder with metadata.yaml and one data file.

Version 8 of the bag format with Humble's message types, which Humble, Iron, Jazzy and later read.
Fixed transforms are on /tf_static, latched for late subscribers. Stamps are exposure times: the
source's clock, set to the wall clock at the first frame, so that a bag plays at the source's pace
however long observing took.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple

import msgspec
import numpy as np

from observer.errors import SourceError
from observer.exporting.choices import BagStorage
from observer.exporting.errors import ExportError
from observer.exporting.foxglove_messages import read_cloud, read_log, read_stamp
from observer.exporting.ros2_messages import RosMessages
from observer.jsonl import line_pose
from observer.recording import topics
from observer.recording.camera_frames import camera_model, fixed_frames
from observer.recording.contents import Message
from observer.recording.drawn import drawn_obstacles, drawn_truth
from observer.recording.images import jpeg_data, raw_pixels
from observer.recording.payloads import MatchedTruth, RecordedFrame
from observer.recording.reader import Recording
from observer.recording.run_times import FramePlaces
from observer.vision.rectification import Rectification

BAG_VERSION: Literal[8] = 8
_SIDES: dict[str, Literal["left", "right"]] = {
    topics.LEFT_RAW.name: "left",
    topics.RIGHT_RAW.name: "right",
}

_STATIC = "/tf_static"
_SECOND_NS = 1_000_000_000


class _Timed(NamedTuple):
    """Message of the bag."""

    topic: str
    wall_ns: int
    message: Any


def write_ros2_bag(
    recording: Recording,
    folder: Path,
    *,
    storage: BagStorage = "sqlite3",
    progress: Callable[[int, int | None], None] | None = None,
) -> dict[str, int]:
    """Write the bag.

    Args:
        folder: created; must not exist. storage: format of its data file.
        progress: called with observations done and the number of frames.

    Returns:
        Number of messages by topic.

    Raises:
        ExportError: rosbags is not installed, the folder exists, cannot be written, or nothing
            was recorded.
    """
    run = _Run(recording)
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.rosbag2.errors import WriterError

    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    counts: dict[str, int] = {}
    connections: dict[str, Any] = {}
    try:
        with Writer(folder, version=BAG_VERSION, storage_plugin=plugin) as writer:
            for timed in run.messages():
                kind = timed.message.__msgtype__
                if timed.topic not in connections:
                    connections[timed.topic] = writer.add_connection(
                        timed.topic,
                        kind,
                        typestore=run.ros.store,
                        offered_qos_profiles=_latched() if timed.topic == _STATIC else (),
                    )
                data = run.ros.store.serialize_cdr(timed.message, kind)
                writer.write(connections[timed.topic], timed.wall_ns, data)
                counts[timed.topic] = counts.get(timed.topic, 0) + 1
                if progress is not None and timed.topic == "/observation":
                    progress(counts[timed.topic], len(recording.frames))
    except WriterError as error:
        raise ExportError(f"the bag {folder} cannot be written: {error}") from None
    except OSError as error:
        raise ExportError(f"the bag {folder} cannot be written: {error.strerror}") from None
    return counts


class _Run:
    """Converts a recording's messages to those of the bag, in the order of the recording."""

    def __init__(self, recording: Recording) -> None:
        self.ros = RosMessages()
        self._recording = recording
        self._calibration = recording.calibration()
        self._rectified = Rectification(self._calibration)
        if not recording.frames:
            raise ExportError(
                f"{recording.path.name} contains no frames, so there is nothing to play"
            )
        self._clock = ExposureClock(recording)

    def messages(self) -> Iterator[_Timed]:
        begin = self._clock.begin_ns
        fixed = fixed_frames(self._rectified, self._recording.facts.camera_mount())
        yield _Timed(_STATIC, begin, self.ros.transforms(fixed, begin))
        read: dict[str, Callable[[Message, str], Iterator[_Timed]]] = {
            **dict.fromkeys(_SIDES, self._image),
            topics.FRAME.name: self._frame,
            topics.OBSERVATION.name: self._observation,
            topics.MATCHED_TRUTH.name: self._truth,
            topics.CLOUD.name: self._cloud,
            topics.LOG.name: self._log,
        }
        for topic, message in self._recording.messages(*read):
            try:
                yield from read[topic](message, topic)
            except SourceError:
                # One damaged message must not prevent the export of the others.
                continue

    def _image(self, message: Message, topic: str) -> Iterator[_Timed]:
        side, at = _SIDES[topic], self._clock.of_wall(read_stamp(message.data))
        if self._recording.facts.images == "lossless":
            image = self.ros.image(raw_pixels(message.data), side, at)
            yield _Timed(f"/camera/{side}/image_raw", at, image)
        else:
            jpeg = self.ros.compressed(jpeg_data(message.data), side, at)
            yield _Timed(f"/camera/{side}/image_raw/compressed", at, jpeg)
        # ROS pairs it with its image by exactly equal stamps.
        given = self._calibration
        model = camera_model(given, self._rectified, side)
        info = self.ros.camera_info(model, given.width, given.height, side, at)
        yield _Timed(f"/camera/{side}/camera_info", at, info)

    def _frame(self, message: Message, topic: str) -> Iterator[_Timed]:
        frame = msgspec.json.decode(message.data, type=RecordedFrame)
        if frame.odometry is not None:
            at = self._clock.of_frame(topic, frame.index, frame.time)
            yield _Timed("/odom", at, self.ros.odometry(frame.odometry, at))

    def _observation(self, message: Message, topic: str) -> Iterator[_Timed]:
        line = msgspec.json.decode(message.data)
        at = self._clock.of_frame(topic, line["frame"], line["time"])
        yield _Timed("/observation", at, self.ros.text(json.dumps(line)))
        yield _Timed("/obstacles", at, self.ros.bodies(drawn_obstacles(line), at))
        T_world_camera = line_pose(line)
        if T_world_camera is not None:
            moving = self.ros.transforms([("world", "camera", T_world_camera)], at)
            yield _Timed("/tf", at, moving)
            yield _Timed("/camera/pose", at, self.ros.pose(T_world_camera, at))

    def _truth(self, message: Message, topic: str) -> Iterator[_Timed]:
        matched = msgspec.json.decode(message.data, type=MatchedTruth)
        at = self._clock.of_frame(topic, matched.frame, matched.time)
        yield _Timed("/truth", at, self.ros.bodies(drawn_truth(matched.bodies), at))

    def _cloud(self, message: Message, _: str) -> Iterator[_Timed]:
        recorded = read_cloud(message.data)
        at = self._clock.of_wall(recorded.stamp_ns)
        yield _Timed("/cloud", at, self.ros.cloud(recorded, at))

    def _log(self, message: Message, _: str) -> Iterator[_Timed]:
        entry = read_log(message.data)
        at = self._clock.of_wall(entry.stamp_ns)
        yield _Timed("/dynamic_observer/log", at, self.ros.log(entry, at))


def _latched() -> list[Any]:
    """Return the quality of service of topics that late subscribers also receive."""
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    # As rmw_qos_profile_default: no deadline.
    never = QosTime(9223372036, 854775807)
    return [
        Qos(
            history=QosHistory.KEEP_LAST,
            depth=1,
            reliability=QosReliability.RELIABLE,
            durability=QosDurability.TRANSIENT_LOCAL,
            deadline=never,
            lifespan=never,
            liveliness=QosLiveliness.AUTOMATIC,
            liveliness_lease_duration=never,
            avoid_ros_namespace_conventions=False,
        )
    ]


class ExposureClock:
    """Clock for tools that have only one: nanoseconds since 1970 at the pace of the source's clock.

    It starts with the first frame. The wall clock at reception would do for live cameras, but not
    for sources observed faster or slower than real time: speeds computed from its stamps would be
    wrong. Where the source's clock goes back, it continues from the wall clock, or from the
    previous frame if that is later.

    Args:
        recording: with at least one frame.
    """

    def __init__(self, recording: Recording) -> None:
        anchor, frames = recording.facts.anchor, recording.frames
        wall = [anchor.wall_time_ns(frame.received) for frame in frames]
        stamps = [wall[0]]
        base_ns, base_time = wall[0], frames[0].time
        for k in range(1, len(frames)):
            if frames[k].time <= frames[k - 1].time:
                base_ns, base_time = max(wall[k], stamps[-1] + 1), frames[k].time
            stamps.append(base_ns + round((frames[k].time - base_time) * _SECOND_NS))
        self._wall = np.maximum.accumulate(np.array(wall, dtype=np.int64))
        self._stamps = np.array(stamps, dtype=np.int64)
        # By topic, because each is asked for in its own order.
        self._places: defaultdict[str, FramePlaces] = defaultdict(lambda: FramePlaces(frames))

    @property
    def begin_ns(self) -> int:
        """Stamp of the first frame."""
        return int(self._stamps[0])

    def of_frame(self, topic: str, index: int, time: float) -> int:
        """Return the stamp of a frame by number and time, or of one near it that was recorded.

        Args:
            topic: whose messages are asked for in the order of the recording.
        """
        places = self._places[topic]
        at = places.of(index, time)
        return int(self._stamps[places.near if at is None else at])

    def of_wall(self, wall_ns: int) -> int:
        """Return the stamp at an instant of the wall clock: a frame's stamp at its reception."""
        k = max(0, int(np.searchsorted(self._wall, wall_ns, side="right")) - 1)
        stamp = int(self._stamps[k]) + max(0, wall_ns - int(self._wall[k]))
        return stamp if k + 1 == len(self._stamps) else min(stamp, int(self._stamps[k + 1]))
