"""Files we write are read by third-party software, as its users would use it.

All in one file, as the run they use is recorded once per test process.
"""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import duckdb
import numpy as np
import pytest
import trimesh
from google.protobuf import descriptor_pb2
from jsonschema import Draft202012Validator
from jsonschema.validators import extend
from mcap.reader import make_reader

from observer.exporting.tables import TABLES
from observer.recording.reader import Recording

_SECOND_NS = 1_000_000_000


class Decoded(NamedTuple):
    """A message of a recording, decoded as one of Foxglove's public types."""

    topic: str
    log_time_ns: int
    message: Any

    @property
    def stamp_ns(self) -> int:
        return int(self.message.timestamp.ToNanoseconds())


def public_type(schema: str) -> Any:
    """Return the published class of ``foxglove.NAME``."""
    name = schema.removeprefix("foxglove.")
    return getattr(import_module(f"foxglove_schemas_protobuf.{name}_pb2"), name)


def decoded_messages(path: Path) -> Iterator[Decoded]:
    """Yield every protobuf message."""
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            if channel.message_encoding == "protobuf":
                decoded = public_type(schema.name).FromString(message.data)
                # The public type knows every field written.
                size = decoded.ByteSize()
                decoded.DiscardUnknownFields()
                assert size == decoded.ByteSize() == len(message.data), schema.name
                yield Decoded(channel.topic, message.log_time, decoded)


@pytest.fixture(scope="session")
def by_topic(recording: Path) -> dict[str, list[Decoded]]:
    """The recording's protobuf messages by topic."""
    found = defaultdict(list)
    for each in decoded_messages(recording):
        found[each.topic].append(each)
    return dict(found)


def unit_quaternion(q: Any) -> bool:
    return bool(np.isclose(np.linalg.norm([q.x, q.y, q.z, q.w]), 1.0))


def points_of(cloud: Any) -> Any:
    """Return a structured array using nothing but the fields named in the message."""
    kinds = {1: "u1", 7: "<f4"}
    layout = {
        "names": [field.name for field in cloud.fields],
        "formats": [kinds[field.type] for field in cloud.fields],
        "offsets": [field.offset for field in cloud.fields],
        "itemsize": cloud.point_stride,
    }
    return np.frombuffer(cloud.data, np.dtype(layout))  # type: ignore[call-overload]


def xyz(points: Any) -> Any:
    return np.stack([points[axis] for axis in "xyz"], axis=1).astype(float)


# --- recordings: MCAP with Foxglove's messages --------------------------------------------------


def test_recorded_schemas_equal_those_published_by_foxglove(
    recording: Path, lossless: Path
) -> None:
    found = set()
    for path in (recording, lossless):
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
        assert summary is not None
        for schema in summary.schemas.values():
            if schema.encoding != "protobuf":
                continue
            found.add(schema.name)
            files = descriptor_pb2.FileDescriptorSet.FromString(schema.data).file
            for own in files:
                if not own.name.startswith("foxglove/"):
                    continue
                public = descriptor_pb2.FileDescriptorProto()
                public_type(own.name[:-6].replace("/", ".")).DESCRIPTOR.file.CopyToProto(public)
                for message in own.message_type:
                    for field in message.field:
                        # Compilers may omit the JSON name, since it follows from the name.
                        field.ClearField("json_name")
                assert list(own.message_type) == list(public.message_type), own.name
                assert list(own.enum_type) == list(public.enum_type), own.name
    assert found == {
        f"foxglove.{name}"
        for name in (
            "CameraCalibration",
            "CompressedImage",
            "FrameTransforms",
            "Odometry",
            "PointCloud",
            "RawImage",
            "SceneUpdate",
        )
    }


def test_decoded_images_match_the_calibration(
    by_topic: dict[str, list[Decoded]], lossless: Path
) -> None:
    for side in ("left", "right"):
        camera = by_topic[f"/camera/{side}/calibration"][0].message
        images = by_topic[f"/camera/{side}/image"]
        stamps = [each.stamp_ns for each in images]
        assert stamps == sorted(set(stamps))
        for each in images:
            assert each.stamp_ns == each.log_time_ns
            assert each.message.frame_id == camera.frame_id == f"camera_{side}"
            assert each.message.format == "jpeg"
        pixels = cv2.imdecode(np.frombuffer(images[-1].message.data, np.uint8), cv2.IMREAD_COLOR)
        assert pixels.shape[:2] == (camera.height, camera.width)
        assert pixels.std() > 10
        assert 0 < camera.K[2] < camera.width
        assert 0 < camera.K[5] < camera.height
        assert np.allclose(np.reshape(camera.R, (3, 3)) @ np.reshape(camera.R, (3, 3)).T, np.eye(3))
    raw = [
        each.message for each in decoded_messages(lossless) if each.topic == "/camera/left/image"
    ]
    with Recording(lossless) as read:
        for k, image in enumerate(raw):
            channels = {"mono8": 1, "bgr8": 3}[image.encoding]
            assert image.step == image.width * channels
            shape = (image.height, image.width, channels)
            pixels = np.frombuffer(image.data, np.uint8).reshape(shape)
            assert np.array_equal(pixels.squeeze(), read.pair(k)[0])


def test_coordinate_frames_form_one_tree_with_every_drawn_frame(
    by_topic: dict[str, list[Decoded]],
) -> None:
    parents: dict[str, str] = {}
    for each in by_topic["/tf"]:
        for transform in each.message.transforms:
            assert unit_quaternion(transform.rotation)
            assert transform.timestamp.ToNanoseconds() == each.log_time_ns
            known = parents.setdefault(transform.child_frame_id, transform.parent_frame_id)
            assert known == transform.parent_frame_id
    assert parents["camera"] == "world"
    drawn = {entity.frame_id for e in by_topic["/scene/obstacles"] for entity in e.message.entities}
    clouds = ("/cloud", "/scene/obstacles/edges", "/scene/truth/edges")
    for topic in (*clouds, "/camera/left/image", "/camera/right/image"):
        drawn |= {each.message.frame_id for each in by_topic[topic]}
    drawn |= {each.message.body_frame_id for each in by_topic["/odometry"]}
    for frame in drawn:
        path = [frame]
        while path[-1] in parents:
            path.append(parents[path[-1]])
            assert len(path) < 10
        assert path[-1] == "level", path


def test_cloud_points_project_onto_their_image_with_its_colours(
    by_topic: dict[str, list[Decoded]],
) -> None:
    camera = by_topic["/camera/left/calibration"][0].message
    # This camera delivers rectified images.
    assert not np.any(camera.D)
    images = {each.stamp_ns: each.message.data for each in by_topic["/camera/left/image"]}
    for each in by_topic["/cloud"]:
        points = points_of(each.message)
        assert len(points) > 1000
        places = np.reshape(camera.P, (3, 4))[:, :3] @ xyz(points).T
        u, v = np.rint(places[:2] / places[2]).astype(int)
        assert (u >= 0).all()
        assert (u < camera.width).all()
        assert (v >= 0).all()
        assert (v < camera.height).all()
        image = cv2.imdecode(np.frombuffer(images[each.stamp_ns], np.uint8), cv2.IMREAD_COLOR)
        colors = np.stack([points[name] for name in ("blue", "green", "red")], axis=1)
        # Bodies have their own colour, and JPEG is lossy.
        assert np.median(np.abs(image[v, u].astype(int) - colors)) <= 4


def test_boxes_and_their_edges_are_drawn_at_the_obstacles(
    by_topic: dict[str, list[Decoded]], recording: Path
) -> None:
    with Recording(recording) as read:
        lines = list(read.lines())
    scenes, edges = by_topic["/scene/obstacles"], by_topic["/scene/obstacles/edges"]
    assert len(lines) == len(scenes) == len(edges)
    drawn = 0
    for line, scene, edge in zip(lines, scenes, edges, strict=True):
        assert scene.log_time_ns == edge.log_time_ns
        expected = {f"obstacle {each['id']}": each for each in line["obstacles"]}
        assert {entity.id for entity in scene.message.entities} == set(expected)
        boxes = []
        for entity in scene.message.entities:
            (cube,), (text,) = entity.cubes, entity.texts
            at, size = cube.pose.position, cube.size
            assert [at.x, at.y, at.z] == expected[entity.id]["position"]
            assert [size.x, size.y, size.z] == expected[entity.id]["size"]
            assert min(size.x, size.y, size.z) > 0
            assert unit_quaternion(cube.pose.orientation)
            assert text.text.endswith("m/s")
            boxes.append((np.array([at.x, at.y, at.z]), np.linalg.norm([size.x, size.y, size.z])))
        points = points_of(edge.message)
        assert bool(len(points)) == bool(boxes)
        for part, (centre, diagonal) in zip(
            np.split(xyz(points), max(1, len(boxes))), boxes, strict=False
        ):
            # Their mean is the centre, and corners are half a diagonal away from it.
            assert np.allclose(part.mean(axis=0), centre, atol=1e-3)
            assert np.linalg.norm(part - centre, axis=1).max() == pytest.approx(diagonal / 2, 1e-3)
            drawn += 1
    assert drawn > 5


def test_own_messages_validate_against_the_schemas_in_the_file(recording: Path) -> None:
    def or_null(validator: Any, kinds: Any, value: Any, schema: Any) -> Iterator[Any]:
        # As in OpenAPI 3.0; Lichtblick does not accept a list of types.
        if not (value is None and schema.get("nullable")):
            yield from Draft202012Validator.VALIDATORS["type"](validator, kinds, value, schema)

    judge = extend(Draft202012Validator, {"type": or_null})
    validators, seen = {}, set()
    with recording.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.message_encoding != "json":
                continue
            if schema.id not in validators:
                declared = json.loads(schema.data)
                judge.check_schema(declared)
                validators[schema.id] = judge(declared)
            validators[schema.id].validate(json.loads(message.data))
            seen.add(channel.topic)
    # This includes messages that only a server records.
    assert {"/run", "/frame", "/observation", "/ego_motion", "/robot", "/truth/matched"} <= seen


# --- tables: Parquet and CSV --------------------------------------------------------------------


@pytest.fixture(scope="session")
def tables(
    recording: Path, command: Callable[..., None], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """A folder with every table as Parquet, and the obstacles as CSV too."""
    folder = tmp_path_factory.mktemp("tables")
    for name in TABLES:
        command("export", recording, "--table", name, "--output", folder / f"{name}.parquet")
    command("export", recording, "--output", folder / "obstacles.csv")
    return folder


def query_rows(query: str, folder: Path) -> list[tuple[Any, ...]]:
    """Return DuckDB's answer; tables in the query are files of the folder."""
    with duckdb.connect() as database:
        database.execute(f"SET file_search_path = '{folder}'")
        return database.execute(query).fetchall()


def test_duckdb_reads_every_table_with_its_types(tables: Path, recording: Path) -> None:
    kinds = {"int": "BIGINT", "float": "DOUBLE", "text": "VARCHAR"}
    with Recording(recording) as read:
        for table in TABLES.values():
            described = query_rows(f"DESCRIBE SELECT * FROM '{table.name}.parquet'", tables)
            assert [(name, kind) for name, kind, *_ in described] == [
                (column.name, kinds[column.kind]) for column in table.columns
            ]
            rows = query_rows(f"SELECT * FROM '{table.name}.parquet'", tables)
            assert rows == [tuple(row.values()) for row in table.rows(read)]
            # The robot has no goal in this run.
            assert rows or table.name in ("goal", "map"), table.name


def test_query_joins_tracks_with_truth_and_csv_gives_the_same_result(
    tables: Path, recording: Path
) -> None:
    with Recording(recording) as read:
        true = {
            (matched.frame, body.track_id): body.speed
            for matched in read.matched_truth()
            for body in matched.bodies
        }
        errors = [
            abs(each["speed"] - true[line["frame"], each["id"]])
            for line in read.lines()
            for each in line["obstacles"]
            if (line["frame"], each["id"]) in true
        ]
    for ending in ("parquet", "csv"):
        query = f"""
            SELECT count(*), avg(abs(o.speed_mps - t.speed_mps))
            FROM 'obstacles.{ending}' o
            JOIN 'matched_truth.parquet' t ON o.frame = t.frame AND o.id = t.track_id
        """
        ((count, mean),) = query_rows(query, tables)
        assert count == len(errors) > 5
        assert mean == pytest.approx(np.mean(errors))
    both = "SELECT * FROM 'obstacles.parquet' EXCEPT ALL SELECT * FROM 'obstacles.csv'"
    assert query_rows(both, tables) == []


# --- point clouds and ROS bags ------------------------------------------------------------------


def test_trimesh_reads_an_exported_cloud(
    recording: Path,
    by_topic: dict[str, list[Decoded]],
    command: Callable[..., None],
    tmp_path: Path,
) -> None:
    path, kept = tmp_path / "cloud.ply", by_topic["/cloud"][0]
    with Recording(recording) as read:
        received = [read.facts.anchor.wall_time_ns(frame.received) for frame in read.frames]
    number = str(received.index(kept.stamp_ns))
    options = ("--frame", number, "--cloud-frame", "camera")
    command("export", recording, "--output", path, *options)
    cloud: Any = trimesh.load(path)
    points = points_of(kept.message)
    assert np.array_equal(cloud.vertices, xyz(points))
    colors = np.stack([points[name] for name in ("red", "green", "blue")], axis=1)
    assert np.array_equal(cloud.colors[:, :3], colors)


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_bag_deserialises_with_its_own_and_newer_ros_definitions(
    recording: Path, command: Callable[..., None], tmp_path: Path, storage: str
) -> None:
    rosbags = pytest.importorskip("rosbags.highlevel", reason="needs rosbags, of the extra ros")
    from rosbags.typesys import Stores, get_typestore

    bag = tmp_path / "bag"
    command("export", recording, "--ros2", "--storage", storage, "--output", bag)
    stores = [get_typestore(each) for each in (Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY)]
    counts: Counter[str] = Counter()
    # Without default types: the definitions come from the bag.
    with rosbags.AnyReader([bag]) as reader:
        for connection, at, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            counts[connection.topic] += 1
            for store in stores:
                again = store.serialize_cdr(
                    store.deserialize_cdr(data, connection.msgtype), connection.msgtype
                )
                assert bytes(again) == bytes(data), connection.topic
            if connection.topic == "/cloud":
                size = message.width * message.point_step
                assert message.row_step == size == len(message.data) > 16_000
            if hasattr(message, "header"):
                stamp = message.header.stamp
                assert stamp.sec * _SECOND_NS + stamp.nanosec == at
    with Recording(recording) as read:
        lines, frames = list(read.lines()), len(read.frames)
    for side in ("left", "right"):
        assert counts[f"/camera/{side}/image_raw/compressed"] == frames
        assert counts[f"/camera/{side}/camera_info"] == frames
    assert counts["/observation"] == counts["/obstacles"] == len(lines)
    assert counts["/tf"] == sum(line["pose"] is not None for line in lines)
    assert counts["/cloud"]
