"""What is written is read back: every type of message, its schema, its times, its images."""

from __future__ import annotations

import json
import resource
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from observer.errors import SourceError
from observer.geometry import Pose
from observer.occupancy import OccupancyMap
from observer.recording import foxglove, topics
from observer.recording.drawn import drawn_obstacles
from observer.recording.errors import RecordingError
from observer.recording.images import jpeg_pixels, raw_pixels
from observer.recording.payloads import (
    Anchor,
    Incident,
    LocalMapPayload,
    ParameterRevision,
    RobotRow,
    RunFacts,
)
from observer.recording.reader import Recording
from observer.recording.ring import Ring
from observer.recording.source import RecordingSource
from observer.recording.writer import RecordingWriter
from observer.sources.contract import SeekableSource, SkippedFrame
from observer.truth.motion_capture import BodySample
from observer.types import StereoFrame


def local_map(frame: StereoFrame) -> LocalMapPayload:
    cells = np.arange(9, dtype=np.uint8).reshape(3, 3) % 3
    made = OccupancyMap.of(cells, (-0.1, 0.2), 0.1, (0.0, 0.1, 0.2), frame.received)
    return LocalMapPayload(frame=frame.index, time=frame.time, map=made)


def everything(writer: RecordingWriter, frames: tuple[StereoFrame, ...], line: Any) -> None:
    """Write at least one message of each type."""
    at = frames[0].received
    values = {"tracking.gate": 3.5, "one_camera.height_m": 0.3}
    writer.parameters(ParameterRevision(revision=1, values=values), at)
    body = {
        "id": 1, "name": "cart", "role": "obstacle", "position": [0.0, 0.0, 3.0],
        "velocity": [0.5, 0.0, 0.0], "speed": 0.5, "size": [0.6, 0.4, 1.0], "yaw": 0.3,
        "visible": None, "commanded_speed": 0.5, "track_id": 3,
    }  # fmt: skip
    for frame in frames[:4]:
        writer.frame(frame, source_position=frame.index, source_time=frame.time)
        ego = {"model": "rigid", "motion": None}
        writer.observation(line(frame), frame.received, ego_motion=ego, truth=[body])
        samples = [
            BodySample("cart", 100.0 + frame.time, frame.received, np.arange(3.0), np.eye(3)),
            BodySample("robot", 100.0 + frame.time, frame.received, None, None),
        ]
        writer.capture(samples)
        writer.robot(RobotRow(role="observer", received=frame.received, encoder_speed=0.2))
        writer.local_map(local_map(frame))
    writer.skipped(SkippedFrame(4, "000004.png is damaged"), at)
    writer.incident(Incident(kind="guard stop", sentence="it stopped", received=at))
    writer.log("info", "engine", "a word", at)
    points = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    writer.cloud(points, np.full((50, 3), 9, np.uint8), at)


def test_everything_written_is_read_back(
    tmp_path: Path, frames: tuple[StereoFrame, ...], facts: Callable[..., RunFacts], line: Any
) -> None:
    path, given_facts = tmp_path / "recording.mcap", facts("jpeg")
    writer = RecordingWriter(path, given_facts)
    everything(writer, frames, line)
    writer.finish()
    writer.finish()
    with Recording(path) as recording:
        assert msgspec.json.encode(recording.facts) == msgspec.json.encode(given_facts)
        assert not recording.unfinished
        assert [f.index for f in recording.frames] == [f.index for f in frames[:4]]
        assert [f.time for f in recording.frames] == [f.time for f in frames[:4]]
        assert [f.received for f in recording.frames] == [f.received for f in frames[:4]]
        assert list(recording.lines()) == [line(frame) for frame in frames[:4]]
        motions = [m.data for _, m in recording.messages(topics.EGO_MOTION.name)]
        assert [msgspec.json.decode(m)["values"]["model"] for m in motions] == ["rigid"] * 4
        assert [m.bodies[0].track_id for m in recording.matched_truth()] == [3] * 4
        assert [r.encoder_speed for r in recording.robot_rows()] == [0.2] * 4
        assert [r.sent_speed for r in recording.robot_rows()] == [None] * 4
        assert list(recording.local_maps()) == [local_map(frame) for frame in frames[:4]]
        assert [s.reason for s in recording.skipped()] == ["000004.png is damaged"]
        assert [i.kind for i in recording.incidents()] == ["guard stop"]
        # Old parameter names are read as today's.
        values = {"tracking.gate": 3.5, "monocular.height_m": 0.3}
        assert recording.parameter_revisions()[0].values == values
        assert recording.truth() is None
        capture = recording.capture()
        assert capture is not None
        assert list(capture.bodies) == ["cart", "robot"]
        assert capture.bodies["robot"].gaps == 4
        assert capture.bodies["robot"].rotations is None
        np.testing.assert_array_equal(capture.bodies["cart"].positions[2], [0.0, 1.0, 2.0])


def test_every_message_conforms_to_the_schema_in_the_file(
    tmp_path: Path, frames: tuple[StereoFrame, ...], facts: Callable[..., RunFacts], line: Any
) -> None:
    path = tmp_path / "recording.mcap"
    writer = RecordingWriter(path, facts("lossless"))
    everything(writer, frames, line)
    writer.finish()
    seen = set()
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            seen.add(channel.topic)
            if channel.message_encoding == "json":
                assert schema.encoding == "jsonschema"
                parsed = json.loads(schema.data)
                for_foxglove(parsed)
                assert problem(json.loads(message.data), parsed) is None, channel.topic
            else:
                assert (schema.encoding, schema.name[:9]) == ("protobuf", "foxglove.")
    declared = {t.name for t in vars(topics).values() if isinstance(t, topics.Topic)}
    assert seen == declared - {topics.TRUTH.name}


def problem(value: Any, schema: dict[str, Any]) -> str | None:
    """Return what violates the schema; covers only the keywords that our schemas use."""
    kinds: dict[str, Any] = {
        "object": dict, "array": list, "string": str, "boolean": bool, "integer": int,
        "number": (int, float),
    }  # fmt: skip
    kind = schema.get("type")
    if kind is None:
        return None
    if value is None:
        return None if schema.get("nullable") else "null"
    if not isinstance(value, kinds[kind]):
        return f"{value!r} is no {kind}"
    if kind == "array":
        return next(filter(None, (problem(v, schema["items"]) for v in value)), None)
    if kind != "object":
        return None
    missing = set(schema.get("required", ())) - set(value)
    if missing:
        return f"without {missing}"
    nested = {p.strip("^$"): s for p, s in schema.get("patternProperties", {}).items()}
    known = {**schema["properties"], **nested}
    further = schema.get("additionalProperties")
    for name, part in value.items():
        if name not in known and not further:
            return f"unknown {name}"
        rule = known.get(name, further if isinstance(further, dict) else {})
        found = problem(part, rule)
        if found:
            return f"{name}: {found}"
    return None


def for_foxglove(schema: dict[str, Any]) -> None:
    """Check what the parsers of Foxglove and Lichtblick demand of each property."""
    assert schema["type"] == "object"
    for part in schema["properties"].values():
        kind = part["type"]
        assert kind in ("boolean", "string", "number", "integer", "object", "array")
        if kind == "object":
            for_foxglove(part)
        elif kind == "array":
            items = part["items"]
            assert items["type"] in ("boolean", "string", "number", "integer", "object")
            if items["type"] == "object":
                for_foxglove(items)


def test_lossless_images_are_read_back_exactly_and_jpeg_approximately(
    write_run: Callable[..., Path], tmp_path: Path, frames: tuple[StereoFrame, ...]
) -> None:
    for images, worst in (("lossless", 0.0), ("jpeg", 3.0)):
        source = RecordingSource(write_run(tmp_path / f"{images}.mcap", images))
        assert isinstance(source, SeekableSource)
        assert source.info.frame_count == len(frames)
        assert source.calibration is not None
        for frame in frames:
            read = source.read()
            assert isinstance(read, StereoFrame)
            assert (read.index, read.time, read.right_time) == (
                frame.index, frame.time, frame.right_time,
            )  # fmt: skip
            assert read.odometry == frame.odometry
            for a, b in ((read.left, frame.left), (read.right, frame.right)):
                assert a.shape == b.shape
                assert np.abs(a.astype(float) - b).mean() <= worst
        assert source.read() is None
        source.rewind()
        assert source.position == 0
        source.close()
        source.close()


@pytest.mark.parametrize("images", ["lossless", "jpeg"])
def test_seeking_finds_any_frame(
    images: str, write_run: Callable[..., Path], tmp_path: Path, frames: tuple[StereoFrame, ...]
) -> None:
    source = RecordingSource(write_run(tmp_path / "recording.mcap", images))
    for position in (17, 3, 0, len(frames) - 1, 9):
        source.seek(position)
        assert source.position == position
        read = source.read()
        assert isinstance(read, StereoFrame)
        assert read.index == frames[position].index
        assert np.abs(read.left.astype(float) - frames[position].left).mean() <= 3.0
    source.seek(len(frames))
    assert source.read() is None
    with pytest.raises(SourceError, match=r"there is no frame 99 in .*; frames are 0 to 23"):
        source.seek(99)
    source.close()


def test_times_keep_increasing_when_the_wall_clock_jumps(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    frames: tuple[StereoFrame, ...],
    facts: Callable[..., RunFacts],
    line: Any,
) -> None:
    """Fault 12: jumps of an hour back and forth, and messages that arrive late."""
    writer = RecordingWriter(tmp_path / "recording.mcap", facts("none"))
    real = time.time_ns
    for k, frame in enumerate(frames[:8]):
        jump = (0, -3600, 3600)[k % 3] * 10**9
        monkeypatch.setattr(time, "time_ns", lambda jump=jump: real() + jump)
        monkeypatch.setattr(time, "time", lambda jump=jump: (real() + jump) * 1e-9)
        writer.frame(frame)
        writer.observation(line(frame), frame.received)
        writer.robot(RobotRow(role="observer", received=frame.received - 0.2))
    writer.finish()
    with Recording(tmp_path / "recording.mcap") as recording:
        names = [t.name for t in vars(topics).values() if isinstance(t, topics.Topic)]
        times = [message.log_time_ns for _, message in recording.messages(*names)]
        stamps = [m.log_time_ns for _, m in recording.messages(topics.FRAME.name)]
    assert times == sorted(times)
    span = frames[7].received - frames[0].received
    assert abs((stamps[-1] - stamps[0]) * 1e-9 - span) < 1e-3


def test_a_ring_saves_the_last_seconds_as_a_recording(
    tmp_path: Path, frames: tuple[StereoFrame, ...], facts: Callable[..., RunFacts], line: Any
) -> None:
    ring = Ring(seconds=0.5)
    writer = RecordingWriter(None, facts("jpeg"), ring=ring)
    writer.parameters(ParameterRevision(revision=4, values={}), frames[0].received)
    for frame in frames:
        writer.frame(frame)
        writer.observation(line(frame), frame.received)
    writer.finish()
    assert 0.4 < ring.seconds_held <= 0.5
    path = tmp_path / "clip.mcap"
    ring.save(path)
    source = RecordingSource(path)
    recording = source.recording
    assert recording.facts.id == "0123"
    assert [r.revision for r in recording.parameter_revisions()] == [4]
    kept = [f.index for f in recording.frames]
    assert kept == list(range(kept[0], len(frames)))
    assert kept[0] >= len(frames) - 9
    read = source.read()
    assert isinstance(read, StereoFrame)
    assert read.index == kept[0]
    assert np.abs(read.left.astype(float) - frames[kept[0]].left).mean() <= 3.0
    source.close()


def test_a_ring_that_cannot_be_saved_leaves_no_file(
    tmp_path: Path, frames: tuple[StereoFrame, ...], facts: Callable[..., RunFacts]
) -> None:
    ring = Ring()
    writer = RecordingWriter(None, facts("lossless"), ring=ring)
    for frame in frames[:4]:
        writer.frame(frame)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, hard))
    try:
        with pytest.raises(RecordingError, match="the disk is full"):
            ring.save(tmp_path / "clip.mcap")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not list(tmp_path.iterdir())


def test_a_ring_stays_within_its_size_limit(
    frames: tuple[StereoFrame, ...], facts: Callable[..., RunFacts]
) -> None:
    size = 2 * frames[0].left.nbytes
    ring = Ring(seconds=30.0, max_bytes=3 * size + 20_000)
    writer = RecordingWriter(None, facts("lossless"), ring=ring)
    for frame in frames:
        writer.frame(frame)
        held = [m for m in ring.messages() if not m.topic.latched]
        assert sum(len(m.data) for m in held) <= 3 * size + 20_000
    held = [m for m in ring.messages() if m.topic is topics.LEFT_RAW]
    assert len(held) == 3
    assert held[-1].sequence == len(frames) - 1


def test_the_clouds_and_scenes_decode_as_protobuf(
    frames: tuple[StereoFrame, ...], line: Any
) -> None:
    for topic, data in (
        (topics.SCENE, foxglove.scene(drawn_obstacles(line(frames[0])), 5)),
        (topics.CLOUD, foxglove.point_cloud(np.ones((2, 3), "f4"), np.ones((2, 3), "u1"), 5)),
        (topics.LEFT_RAW, foxglove.raw_image(frames[0].left, "left", 5)),
    ):
        pool = descriptor_pool.DescriptorPool()
        for file in descriptor_pb2.FileDescriptorSet.FromString(topic.schema()).file:
            pool.Add(file)
        kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(topic.schema_name))
        decoded = kind.FromString(data)
        if topic is topics.LEFT_RAW:
            assert decoded.data == frames[0].left.tobytes()
            assert decoded.width == frames[0].left.shape[1]
        elif topic is topics.CLOUD:
            assert len(decoded.data) == 2 * decoded.point_stride
        else:
            assert decoded.entities[0].texts[0].text == "3: 1.00 ± 0.10 m/s"
            assert decoded.entities[0].arrows[0].head_length > 0


@given(st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-3))
def test_an_arrow_points_along_its_velocity(velocity: tuple[float, float, float]) -> None:
    turn = foxglove._turn_from_x(velocity)
    ahead = Pose.from_quaternion(turn, (0, 0, 0)).rotate([1.0, 0.0, 0.0])
    np.testing.assert_allclose(ahead, np.array(velocity) / np.linalg.norm(velocity), atol=1e-6)


@given(st.binary(max_size=60))
def test_invalid_image_messages_are_refused(data: bytes) -> None:
    for read in (raw_pixels, jpeg_pixels):
        with pytest.raises(SourceError):
            read(memoryview(data))


def test_an_anchor_converts_monotonic_time_to_wall_time() -> None:
    anchor = Anchor(wall_ns=10**18, monotonic=5.0)
    assert anchor.wall_time_ns(6.5) == 10**18 + 1_500_000_000
