"""Encoder of the events of a run as messages of its recording; no file, no thread."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from observer.calibration.formats.opencv_file import read_calibration
from observer.jsonl import line_pose
from observer.recording import foxglove, topics
from observer.recording.drawn import drawn_obstacles, drawn_truth
from observer.recording.payloads import (
    Begins,
    EgoMotionPayload,
    Incident,
    LocalMapPayload,
    MatchedBody,
    MatchedTruth,
    ParameterRevision,
    RecordedFrame,
    RobotRow,
    RunFacts,
)
from observer.recording.topics import Topic
from observer.sources.contract import SkippedFrame
from observer.truth.motion_capture import BodySample
from observer.truth.sampled import TruthSample
from observer.types import Image, StereoFrame

JPEG_QUALITY = 95


def _plain(value: object) -> object:
    """Convert numpy's numbers and arrays to plain values for JSON."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} cannot be recorded")


_json = msgspec.json.Encoder(enc_hook=_plain)


class Encoded(NamedTuple):
    """Message that is ready to be written.

    Attributes:
        sequence: counted within its topic. log_time_ns: nanoseconds since 1970, never decreasing.
    """

    topic: Topic
    sequence: int
    log_time_ns: int
    data: bytes


class Encoder:
    """Makes messages and passes them to ``_keep``, which a subclass defines.

    Log times are the anchor's wall clock plus the time since then on the monotonic clock, so they
    never decrease, whatever happens to the wall clock. ``received`` is the host's monotonic clock,
    seconds, everywhere.

    Args:
        facts: of the run. first_image: number of the first pair of images.
        after_ns: earliest log time of all messages.

    Raises:
        CalibrationError: the calibration's text cannot be used.
    """

    def __init__(self, facts: RunFacts, *, first_image: int = 0, after_ns: int = 0) -> None:
        self.facts = facts
        calibration = read_calibration(facts.calibration_yaml, name="the run's calibration")
        self._cameras = foxglove.Cameras(calibration, facts.camera_mount())
        self._image = first_image
        self._newest_ns = after_ns
        self._sequences: dict[str, int] = {}
        # The first frame is always the first one of a new observer.
        self._begins: Begins | None = "observer"

    def _keep(self, messages: Sequence[Encoded]) -> None:
        raise NotImplementedError

    def _begin(self) -> None:
        """Record the run's facts and the cameras, with which a recording begins."""
        at = self.facts.anchor.monotonic
        wall = self.facts.anchor.wall_time_ns(at)
        left, right = (self._cameras.calibration(side, wall) for side in ("left", "right"))
        self._keep(
            [
                self._own(topics.RUN, self.facts, at),
                self._made(topics.LEFT_CALIBRATION, left, at),
                self._made(topics.RIGHT_CALIBRATION, right, at),
            ]
        )

    def frame(
        self,
        frame: StereoFrame,
        *,
        source_position: int | None = None,
        source_time: float | None = None,
        begins: Begins | None = None,
    ) -> None:
        """Record a frame exactly as the observer gets it, before it is observed.

        Args:
            source_position, source_time: within a source that is played in a loop.
            begins: ``segment`` if ``begin_segment`` was called for it.
        """
        at, image = frame.received, None
        messages = []
        if self.facts.images != "none":
            image = self._image
            self._image += 1
            # One after the other, because packing each one keeps a core busy.
            for side, pixels in (("left", frame.left), ("right", frame.right)):
                topic, data = self._packed(side, pixels, self._wall(at))
                messages.append(Encoded(topic, image, self._log_time(at), data))
        recorded = RecordedFrame(
            index=frame.index,
            time=frame.time,
            received=frame.received,
            right_time=frame.right_time,
            odometry=frame.odometry,
            source_position=source_position,
            source_time=source_time,
            image=image,
            begins=self._begins or begins,
        )
        self._begins = None
        messages.append(self._own(topics.FRAME, recorded, at))
        if frame.odometry is not None:
            data = foxglove.odometry(frame.odometry, self._wall(at))
            messages.append(self._made(topics.ODOMETRY, data, at))
        self._keep(messages)

    def observation(
        self,
        line: Mapping[str, Any],
        received: float,
        *,
        ego_motion: Mapping[str, Any] | None = None,
        truth: Sequence[Mapping[str, Any]] = (),
        no_truth: str | None = None,
    ) -> None:
        """Record the JSON line of an observation, and its drawing.

        Args:
            line: as from ``observer.jsonl.observation_line``. received: of its frame.
            ego_motion, truth: as in the engine's ``ObservationEvent``.
            no_truth: why the run's ground truth is not available yet. Its topics are then written
                with this sentence, so that every recording with truth has them from its first
                frame.
        """
        wall = self._wall(received)
        transforms = self._cameras.transforms(line_pose(line), wall)
        boxes = drawn_obstacles(line)
        messages = [
            self._own(topics.OBSERVATION, line, received),
            self._made(topics.TRANSFORMS, transforms, received),
            self._made(topics.SCENE, foxglove.scene(boxes, wall), received),
            self._made(topics.EDGES, foxglove.box_edges(boxes, wall), received),
        ]
        if ego_motion is not None:
            values = EgoMotionPayload(
                frame=line["frame"], time=line["time"], values=dict(ego_motion)
            )
            messages.append(self._own(topics.EGO_MOTION, values, received))
        if truth or no_truth is not None:
            bodies = [MatchedBody.of(entry) for entry in truth]
            matched = MatchedTruth(
                frame=line["frame"], time=line["time"], bodies=bodies, sentence=no_truth
            )
            boxes = drawn_truth(bodies)
            messages += [
                self._own(topics.MATCHED_TRUTH, matched, received),
                self._made(topics.TRUE_SCENE, foxglove.scene(boxes, wall), received),
                self._made(topics.TRUE_EDGES, foxglove.box_edges(boxes, wall), received),
            ]
        # Together: a killed writer must not leave obstacles without the truth that they are
        # compared with, which would count them as false.
        self._keep(messages)

    def truth(self, sample: TruthSample, received: float) -> None:
        """Record the ground truth at a frame, before its observation.

        ``frame`` and ``time`` are those of the frame as observed; the world is the truth's own.
        """
        pose = sample.camera_pose
        # The fields of ``TruthPayload`` and ``BodyPayload``.
        payload = {
            "frame": sample.frame,
            "time": sample.time,
            "bodies": sample.bodies,
            "camera_position": None if pose is None else pose.translation,
            "camera_orientation_wxyz": None if pose is None else pose.quaternion_wxyz,
        }
        self._keep([self._own(topics.TRUTH, payload, received)])

    def parameters(self, revision: ParameterRevision, received: float) -> None:
        """Record the parameters that apply from the next recorded frame on."""
        self._keep([self._own(topics.PARAMETERS, revision, received)])

    def capture(self, samples: Sequence[BodySample]) -> None:
        """Record the motion capture samples since the last call."""
        if not samples:
            return
        # The fields of ``SamplePayload``.
        payloads = [
            {**vars(s), "rotation": None if s.rotation is None else s.rotation.ravel()}
            for s in samples
        ]
        newest = max(sample.received for sample in samples)
        self._keep([self._own(topics.MOTION_CAPTURE, {"samples": payloads}, newest)])

    def robot(self, row: RobotRow) -> None:
        """Record the state of one robot at one instant."""
        self._keep([self._own(topics.ROBOT, row, row.received)])

    def local_map(self, payload: LocalMapPayload) -> None:
        """Record the local map that was used to plan the path to a goal."""
        self._keep([self._own(topics.LOCAL_MAP, payload, payload.map.received)])

    def skipped(self, skipped: SkippedFrame, received: float) -> None:
        """Record the number of a frame that the source could not read."""
        self._keep(
            [
                self._own(topics.SKIPPED, skipped, received),
                self._log("warning", "source", skipped.reason, received),
            ]
        )

    def incident(self, incident: Incident) -> None:
        """Record an incident, in the log as well."""
        self._keep(
            [
                self._own(topics.INCIDENT, incident, incident.received),
                self._log("warning", incident.kind, incident.sentence, incident.received),
            ]
        )

    def log(self, level: foxglove.LogLevel, name: str, message: str, received: float) -> None:
        """Record a sentence in the log."""
        self._keep([self._log(level, name, message, received)])

    def cloud(
        self, points: NDArray[np.float32], colors: NDArray[np.uint8], received: float
    ) -> None:
        """Record a dense cloud: points (N, 3), metres, in the camera frame, and RGB (N, 3).

        Args:
            received: of the frame that it was computed from.
        """
        data = foxglove.point_cloud(points, colors, self._wall(received))
        self._keep([self._made(topics.CLOUD, data, received)])

    # ---------------------------------------------------------------------------------------

    def _wall(self, received: float) -> int:
        return self.facts.anchor.wall_time_ns(received)

    def _log_time(self, received: float) -> int:
        self._newest_ns = max(self._newest_ns, self._wall(received))
        return self._newest_ns

    def _log(self, level: foxglove.LogLevel, name: str, message: str, received: float) -> Encoded:
        data = foxglove.log(level, name, message, self._wall(received))
        return self._made(topics.LOG, data, received)

    def _own(self, topic: Topic, payload: object, received: float) -> Encoded:
        return self._made(topic, _json.encode(payload), received)

    def _made(self, topic: Topic, data: bytes, received: float) -> Encoded:
        sequence = self._sequences.get(topic.name, 0)
        self._sequences[topic.name] = sequence + 1
        return Encoded(topic, sequence, self._log_time(received), data)

    def _packed(self, side: str, pixels: Image, wall_ns: int) -> tuple[Topic, bytes]:
        left = side == "left"
        if self.facts.images == "lossless":
            topic = topics.LEFT_RAW if left else topics.RIGHT_RAW
            return topic, foxglove.raw_image(pixels, side, wall_ns)
        _, jpeg = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        topic = topics.LEFT_JPEG if left else topics.RIGHT_JPEG
        return topic, foxglove.jpeg_image(jpeg.tobytes(), side, wall_ns)
