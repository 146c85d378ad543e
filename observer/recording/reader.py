"""Reader of a recording, shared by reports, re-runs, exports and notebooks."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar, cast

import msgspec
import numpy as np

from observer.calibration.formats.opencv_file import read_calibration
from observer.camera import StereoCalibration
from observer.errors import SourceError, TruthError
from observer.geometry import Pose
from observer.jsonl import ObservationLine
from observer.parameters import translated
from observer.recording import topics
from observer.recording.contents import (
    Contents,
    Message,
    chunk_records,
    find_contents,
    messages_of,
)
from observer.recording.payloads import (
    CapturePayload,
    Incident,
    LocalMapPayload,
    MatchedTruth,
    ParameterRevision,
    RecordedFrame,
    RobotRow,
    RunFacts,
    SamplePayload,
    SkippedPayload,
    TruthPayload,
)
from observer.recording.recorded_images import RecordedImages
from observer.recording.run_times import FramePlaces, RunTimes
from observer.recording.topics import Topic
from observer.truth.contract import TrueBody, Truth
from observer.truth.motion_capture import (
    BodySample,
    Capture,
    Trajectory,
    rising_samples,
    trajectory_of,
)
from observer.truth.sampled import SampledTruth, TruthSample
from observer.types import Image

_Payload = TypeVar("_Payload", bound=msgspec.Struct)
_Decoded = TypeVar("_Decoded")


class Recording:
    """A recording on disk, finished or not; nothing is written to it.

    Used by one thread. Times are those of ``payloads``.

    Attributes:
        unfinished: its end was never written, because it is still being written or its writer was
            killed; everything up to its last complete chunk is read.

    Raises:
        SourceError: the file cannot be read or is not the recording of a run.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        try:
            # Closed by ``close``.
            self._file = self.path.open("rb")
        except OSError as error:
            raise SourceError(f"{path} cannot be read: {error.strerror}") from None
        try:
            self._contents: Contents = find_contents(self._file, self.path.name)
            self.facts: RunFacts = self._first_facts()
        except BaseException:
            self._file.close()
            raise
        self.unfinished = not self._contents.finished
        self._images = RecordedImages(self._file, self._contents, self.path.name)

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; safe to call twice."""
        self._file.close()

    # --- what was recorded -------------------------------------------------------------------

    def calibration(self) -> StereoCalibration:
        """Return the calibration that the run was observed with.

        Raises:
            CalibrationError: it cannot be used.
        """
        name = f"the calibration in {self.path.name}"
        return read_calibration(self.facts.calibration_yaml, name=name)

    @cached_property
    def frames(self) -> tuple[RecordedFrame, ...]:
        """Frames, in order."""
        return tuple(self._payloads(topics.FRAME, RecordedFrame))

    def lines(self) -> Iterator[ObservationLine]:
        """Yield the observations' JSON lines, in order; their fields are not checked."""
        decoder = msgspec.json.Decoder(dict[str, Any])
        for topic, message in self.messages(topics.OBSERVATION.name):
            yield cast(ObservationLine, self._decoded(decoder, topic, message))

    def positioned_lines(self) -> Iterator[tuple[int | None, ObservationLine]]:
        """Yield the lines, each with the position of its frame; None if that is lost.

        Numbers and times of frames may repeat; see ``FramePlaces``.
        """
        places = FramePlaces(self.frames)
        for line in self.lines():
            yield places.of(line["frame"], line["time"]), line

    @cached_property
    def positioned_revisions(self) -> tuple[tuple[int, ParameterRevision], ...]:
        """Parameter revisions, each with the position of the first frame that it applies to."""
        found: list[tuple[int, ParameterRevision]] = []
        position = 0
        decoder = msgspec.json.Decoder(ParameterRevision)
        for topic, message in self.messages(topics.FRAME.name, topics.PARAMETERS.name):
            if topic == topics.FRAME.name:
                position += 1
            else:
                recorded = self._decoded(decoder, topic, message)
                values, difference = translated(recorded.values), translated(recorded.difference)
                if found and not difference:
                    # A new engine does not know what the replaced one used.
                    before = found[-1][1].values
                    difference = {k: v for k, v in values.items() if before.get(k, v) != v}
                revision = msgspec.structs.replace(recorded, values=values, difference=difference)
                found.append((position, revision))
        return tuple(found)

    def parameter_revisions(self) -> tuple[ParameterRevision, ...]:
        """Return the parameters that were used, in order."""
        return tuple(revision for _, revision in self.positioned_revisions)

    def _true(self, payload: TruthPayload) -> TruthSample:
        # Malformed vectors and quaternions raise ValueError.
        try:
            return _truth_sample(payload)
        except ValueError:
            raise self._unlike_ours(topics.TRUTH.name) from None

    def truth(self) -> Truth | None:
        """Return the true bodies over the run's time (see ``RunTimes``); None if none are known."""
        return RunTimes(self.frames).truth(self.truths())

    def truths(self) -> tuple[tuple[int, SampledTruth | None], ...]:
        """Return the true bodies on the source's clock, with the position of their first frame.

        Where an engine was replaced or the frames' time steps back, others begin: the same times
        may come again, but the bodies may be elsewhere.
        """
        parts: list[tuple[int, list[TruthSample]]] = [(0, [])]
        position, newest = 0, -math.inf
        of_frame = msgspec.json.Decoder(RecordedFrame)
        of_truth = msgspec.json.Decoder(TruthPayload)
        for topic, message in self.messages(topics.FRAME.name, topics.TRUTH.name):
            if topic == topics.FRAME.name:
                frame = self._decoded(of_frame, topic, message)
                if position and (frame.begins == "observer" or frame.time < newest):
                    parts.append((position, []))
                position, newest = position + 1, frame.time
                continue
            payload, samples = self._decoded(of_truth, topic, message), parts[-1][1]
            if not samples or payload.time > samples[-1].time:
                samples.append(self._true(payload))
        return tuple((at, SampledTruth(tuple(part)) if part else None) for at, part in parts)

    def matched_truth(self) -> Iterator[MatchedTruth]:
        """Yield true bodies in the observations' world, each with its matched track, in order.

        Frames from before motion capture was aligned are left out.
        """
        payloads = self._payloads(topics.MATCHED_TRUTH, MatchedTruth)
        return (each for each in payloads if each.sentence is None)

    def capture_samples(self) -> Iterator[BodySample]:
        """Yield the samples of live motion capture, in order of arrival."""
        for payload in self._payloads(topics.MOTION_CAPTURE, CapturePayload):
            for sample in payload.samples:
                try:
                    yield _body_sample(sample)
                except ValueError:
                    raise self._unlike_ours(topics.MOTION_CAPTURE.name) from None

    def capture(self) -> Capture | None:
        """Return the samples by body, on the server's own clock; None if there are none.

        Samples whose time stamp does not increase are left out.
        """
        samples = tuple(self.capture_samples())
        if not samples:
            return None
        bodies = rising_samples(samples)
        dropped = len(samples) - sum(map(len, bodies.values()))
        notes = [f"{dropped} samples with a non-increasing timestamp were skipped"]
        trajectories = {name: _trajectory(name, kept) for name, kept in bodies.items()}
        return Capture("recorded live", None, trajectories, tuple(notes if dropped else ()))

    def robot_rows(self) -> Iterator[RobotRow]:
        """Yield commands sent to the robots and what they reported, in order."""
        return self._payloads(topics.ROBOT, RobotRow)

    def local_maps(self) -> Iterator[LocalMapPayload]:
        """Yield the local maps used to plan paths to goals, in order."""
        return self._payloads(topics.LOCAL_MAP, LocalMapPayload)

    def skipped(self) -> Iterator[SkippedPayload]:
        """Yield the frames that the source could not read, in order."""
        return self._payloads(topics.SKIPPED, SkippedPayload)

    def incidents(self) -> Iterator[Incident]:
        """Yield the incidents, in order."""
        return self._payloads(topics.INCIDENT, Incident)

    # --- images ------------------------------------------------------------------------------

    def pair(self, position: int) -> tuple[Image, Image]:
        """Return the left and right image of a frame, as taken; read-only if they are raw.

        Args:
            position: of the frame, from 0.

        Raises:
            SourceError: the recording holds no images, none of this frame, or damaged ones.
        """
        number = self._image_of(position)
        return self._images.left(number), self._images.right(number)

    def left(self, position: int) -> Image:
        """Return only the left image of a frame, as ``pair`` does.

        Raises:
            SourceError: the recording holds no images, none of this frame, or a damaged one.
        """
        return self._images.left(self._image_of(position))

    def _image_of(self, position: int) -> int:
        number = self.frames[position].image
        if number is None:
            raise SourceError(
                f"{self.path.name} was recorded without images; choose jpeg or lossless images for "
                "recordings that can be played"
            )
        return number

    @property
    def images_held(self) -> range:
        """Numbers of all pairs of images."""
        return self._images.numbers

    @property
    def end_ns(self) -> int:
        """Newest log time, nanoseconds since 1970."""
        return max((c.index.message_end_time for c in self._contents.chunks), default=0)

    # --- messages ----------------------------------------------------------------------------

    def messages(self, *names: str) -> Iterator[tuple[str, Message]]:
        """Yield the messages of these topics in the order written, each with its topic.

        Chunks without any of them are not unpacked, and damaged ones are skipped.
        """
        channels = self._contents.channel_ids(*names)
        for chunk in self._contents.chunks:
            if channels.isdisjoint(chunk.channels):
                continue
            try:
                records = chunk_records(self._file, chunk, self.path.name)
            except SourceError:
                continue
            for message in messages_of(records):
                if message.channel in channels:
                    yield self._contents.channels[message.channel].topic, message

    def _payloads(self, topic: Topic, kind: type[_Payload]) -> Iterator[_Payload]:
        decoder = msgspec.json.Decoder(kind)
        for name, message in self.messages(topic.name):
            yield self._decoded(decoder, name, message)

    def _decoded(
        self, decoder: msgspec.json.Decoder[_Decoded], topic: str, message: Message
    ) -> _Decoded:
        try:
            return decoder.decode(message.data)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
            raise self._unlike_ours(topic) from None

    def _unlike_ours(self, topic: str) -> SourceError:
        return SourceError(
            f"{self.path.name} is damaged: a message of {topic} has an unexpected format; give an "
            "intact recording"
        )

    def _first_facts(self) -> RunFacts:
        try:
            facts = next(self._payloads(topics.RUN, RunFacts), None)
        except SourceError:
            facts = None
        if facts is None:
            raise SourceError(
                f"{self.path.name} is not a recording of a run, or it ends within its first "
                "second; give a recording.mcap written by this program"
            )
        return facts


def _body_sample(payload: SamplePayload) -> BodySample:
    return BodySample(
        name=payload.name,
        time=payload.time,
        received=payload.received,
        position=None if payload.position is None else np.array(payload.position).reshape(3),
        rotation=None if payload.rotation is None else np.array(payload.rotation).reshape(3, 3),
    )


def _truth_sample(payload: TruthPayload) -> TruthSample:
    pose = None
    if payload.camera_position is not None and payload.camera_orientation_wxyz is not None:
        pose = Pose.from_quaternion(payload.camera_orientation_wxyz, payload.camera_position)
    bodies = []
    for body in payload.bodies:
        vectors = {
            name: np.array(getattr(body, name)).reshape(3)
            for name in ("position", "velocity", "size")
        }
        box = None if body.box_px is None else tuple(np.array(body.box_px).reshape(4).tolist())
        bodies.append(TrueBody(**{**msgspec.structs.asdict(body), **vectors, "box_px": box}))
    return TruthSample(payload.frame, payload.time, tuple(bodies), pose)


def _trajectory(name: str, samples: list[BodySample]) -> Trajectory:
    try:
        return trajectory_of(name, samples)
    except ValueError as error:
        raise TruthError(f"{name}: the recorded samples are damaged: {error}") from None
