"""A bag read message by message with rosbags' own reader; ROS itself is not used."""

from __future__ import annotations

import json
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from observer.exporting.errors import ExportError
from observer.exporting.ros2 import write_ros2_bag
from observer.recording.reader import Recording

from .conftest import FRAMES

pytest.importorskip("rosbags", reason="needs rosbags, of the extra ros")

_KINDS = {
    "/camera/left/camera_info": "sensor_msgs/msg/CameraInfo",
    "/camera/right/camera_info": "sensor_msgs/msg/CameraInfo",
    "/odom": "nav_msgs/msg/Odometry",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/camera/pose": "geometry_msgs/msg/PoseStamped",
    "/obstacles": "visualization_msgs/msg/MarkerArray",
    "/truth": "visualization_msgs/msg/MarkerArray",
    "/observation": "std_msgs/msg/String",
    "/cloud": "sensor_msgs/msg/PointCloud2",
    "/dynamic_observer/log": "rcl_interfaces/msg/Log",
}


def messages_of(folder: Path) -> dict[str, list[tuple[int, str, Any]]]:
    """Return every message of the bag by topic: its time, type and content."""
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    found = defaultdict(list)
    with Reader(folder) as reader:
        for connection, at, data in reader.messages():
            message = store.deserialize_cdr(data, connection.msgtype)
            found[connection.topic].append((at, connection.msgtype, message))
    return found


def nanoseconds(stamp: Any) -> int:
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


@pytest.mark.parametrize(
    ("images", "storage"), [("jpeg", "sqlite3"), ("lossless", "mcap"), ("none", "sqlite3")]
)
def test_every_message_is_read_back(
    recorded: dict[str, Path], tmp_path: Path, images: str, storage: Any
) -> None:
    bag = tmp_path / "bag"
    with Recording(recorded[images]) as recording:
        counts = write_ros2_bag(recording, bag, storage=storage)
        read = messages_of(bag)
        assert {topic: len(told) for topic, told in read.items()} == counts
        expected = dict(_KINDS)
        if images == "none":
            for side in ("left", "right"):
                del expected[f"/camera/{side}/camera_info"]
        if images == "jpeg":
            expected["/camera/left/image_raw/compressed"] = "sensor_msgs/msg/CompressedImage"
            expected["/camera/right/image_raw/compressed"] = "sensor_msgs/msg/CompressedImage"
        if images == "lossless":
            expected["/camera/left/image_raw"] = "sensor_msgs/msg/Image"
            expected["/camera/right/image_raw"] = "sensor_msgs/msg/Image"
        assert {topic: told[0][1] for topic, told in read.items()} == expected
        times = np.array([frame.time for frame in recording.frames])
        # Observing took three times as long as the run, but stamps are exposure times.
        seen = np.array([at for at, _, _ in read["/observation"]])
        assert np.abs(np.diff(seen) * 1e-9 - np.diff(times)).max() < 1e-8
        lines = [json.loads(told.data) for _, _, told in read["/observation"]]
        assert lines == list(recording.lines())
        _check_boxes(lines, [told for _, _, told in read["/obstacles"]])
        _check_cloud(read["/cloud"][0], int(seen[5]))
        log = read["/dynamic_observer/log"][0][2]
        assert (log.level, log.name, log.msg) == (30, "engine", "it is 3 ± 1")
        if images == "lossless":
            left, _ = recording.pair(3)
            _, _, image = read["/camera/left/image_raw"][3]
            shape = left.shape if left.ndim == 3 else (*left.shape, 1)
            assert np.array_equal(image.data.reshape(shape), left.reshape(shape))
        if images == "jpeg":
            at, _, image = read["/camera/right/image_raw/compressed"][3]
            pixels = cv2.imdecode(image.data, cv2.IMREAD_UNCHANGED)
            assert np.array_equal(pixels, recording.pair(3)[1])
            info = read["/camera/right/camera_info"][3][2]
            assert nanoseconds(info.header.stamp) == nanoseconds(image.header.stamp) == at
            assert info.p[3] < 0 < info.k[0]


def _check_boxes(lines: list[Any], markers: list[Any]) -> None:
    seen = 0
    for line, told in zip(lines, markers, strict=True):
        # The markers of the frame before are deleted first.
        assert told.markers[0].action == 3
        boxes = {m.id: m for m in told.markers if m.ns == "obstacle"}
        assert sorted(boxes) == sorted(entry["id"] for entry in line["obstacles"])
        for entry in line["obstacles"]:
            at = boxes[entry["id"]].pose.position
            assert [at.x, at.y, at.z] == entry["position"]
            seen += 1
    assert seen


def _check_cloud(told: tuple[int, str, Any], at: int) -> None:
    assert told[0] == at
    cloud = told[2]
    assert (cloud.width, cloud.point_step, [f.name for f in cloud.fields]) == (
        5, 16, ["x", "y", "z", "rgb"],
    )  # fmt: skip
    rows = cloud.data.reshape(5, 16)
    assert np.array_equal(rows[:, :12].copy().view("<f4").ravel(), np.arange(15))
    # 0x00RRGGBB, little endian.
    assert rows[0, 12:].tolist() == [7, 8, 9, 0]


def test_transforms_form_one_tree_and_static_ones_are_latched(
    recorded: dict[str, Path], tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    with Recording(recorded["none"]) as recording:
        write_ros2_bag(recording, bag)
    read = messages_of(bag)
    told = [t for topic in ("/tf", "/tf_static") for _, _, m in read[topic] for t in m.transforms]
    parents = {t.child_frame_id: t.header.frame_id for t in told}
    assert parents == {
        "world": "level",
        "camera": "world",
        "camera_left": "camera",
        "camera_right": "camera",
        "base": "camera",
    }
    facts = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert facts["version"] == 8
    assert facts["storage_identifier"] == "sqlite3"
    assert [(bag / name).is_file() for name in facts["relative_file_paths"]] == [True]
    topics = {each["topic_metadata"]["name"]: each for each in facts["topics_with_message_count"]}
    assert topics["/odom"]["message_count"] == FRAMES
    qos = yaml.safe_load(topics["/tf_static"]["topic_metadata"]["offered_qos_profiles"])
    assert qos[0]["durability"] == 1


def test_without_the_package_the_extra_is_named(
    recorded: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with Recording(recorded["none"]) as recording, pytest.raises(ExportError) as refused:
        write_ros2_bag(recording, tmp_path / "bag")
    assert "dynamic-observer[ros]" in str(refused.value)
    assert not (tmp_path / "bag").exists()
