"""The frames published to Foxglove are where the cameras really are."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

import cv2
import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from observer.geometry import Pose
from observer.mount import CameraMount
from observer.opening import open_source
from observer.recording import foxglove, topics
from observer.recording.drawn import DrawnBody, drawn_truth
from observer.recording.payloads import MatchedBody
from observer.recording.topics import Topic
from observer.vision.rectification import Rectification


def decoded(topic: Topic, data: bytes) -> Any:
    """Decode a message using only the schema in the file."""
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(topic.schema()).file:
        pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(topic.schema_name))
    return kind.FromString(data)


def poses(message: Any) -> dict[tuple[str, str], Pose]:
    """Return (parent, child) -> T_parent_child."""
    found = {}
    for t in message.transforms:
        turn = (t.rotation.w, t.rotation.x, t.rotation.y, t.rotation.z)
        shift = (t.translation.x, t.translation.y, t.translation.z)
        found[t.parent_frame_id, t.child_frame_id] = Pose.from_quaternion(turn, shift)
    return found


def test_camera_points_project_where_the_calibration_messages_say() -> None:
    opened = open_source("simulated:distorted_tilted")
    calibration = opened.source.calibration
    opened.source.close()
    assert calibration is not None
    assert not calibration.is_rectified
    cameras = foxglove.Cameras(calibration, None)
    rectification = Rectification(calibration)
    frames = poses(decoded(topics.TRANSFORMS, cameras.transforms(Pose.identity(), 7)))
    points = np.array([[0.3, -0.1, 3.0], [-0.8, 0.2, 4.0], [0.1, 0.3, 2.0]])
    taken = []
    sides: list[tuple[Literal["left", "right"], Any]] = [
        ("left", topics.LEFT_CALIBRATION),
        ("right", topics.RIGHT_CALIBRATION),
    ]
    for side, topic in sides:
        told = decoded(topic, cameras.calibration(side, 7))
        assert told.frame_id == f"camera_{side}"
        assert told.distortion_model == "plumb_bob"
        own = frames["camera", f"camera_{side}"].inverse().apply(points)
        K, D = np.array(told.K).reshape(3, 3), np.array(told.D)
        px = cv2.projectPoints(own, np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
        taken.append(px)
        # Once rectified, it is where the message's R and P put it.
        turned = own @ np.array(told.R).reshape(3, 3).T
        flat = np.hstack([turned, np.ones((3, 1))]) @ np.array(told.P).reshape(3, 4).T
        rectified = rectification.rectify_points(px, px)[0 if side == "left" else 1]
        # Nothing is shifted in the right camera's own frame: P's baseline term is for points in
        # the left one's.
        shift = 0.0 if side == "left" else told.P[3] / points[:, 2]
        np.testing.assert_allclose(flat[:, 0] / flat[:, 2] - shift, rectified[:, 0], atol=0.02)
        np.testing.assert_allclose(flat[:, 1] / flat[:, 2], rectified[:, 1], atol=0.02)
    left, right = rectification.rectify_points(*taken)
    expected, disparity = rectification.camera.project(points)
    np.testing.assert_allclose(left, expected, atol=0.02)
    np.testing.assert_allclose(left[:, 0] - right[:, 0], disparity, atol=0.03)


def test_the_level_frame_has_the_floor_at_zero_and_the_base_on_it() -> None:
    opened = open_source("simulated:lab")
    calibration = opened.source.calibration
    opened.source.close()
    assert calibration is not None
    mount = CameraMount(0.6, 0.2, forward_m=0.1, left_m=0.05)
    cameras = foxglove.Cameras(calibration, mount)
    frames = poses(decoded(topics.TRANSFORMS, cameras.transforms(Pose.identity(), 7)))
    T_level_camera = frames["level", "world"] @ frames["world", "camera"]
    np.testing.assert_allclose(T_level_camera.translation[2], 0.6)
    np.testing.assert_allclose(
        (T_level_camera @ frames["camera", "base"]).translation[2], 0.0, atol=1e-9
    )
    # Without a pose nothing is published about where the camera is.
    lost = poses(decoded(topics.TRANSFORMS, cameras.transforms(None, 7)))
    assert ("world", "camera") not in lost


def test_a_dashed_box_has_the_size_and_heading_of_the_truth() -> None:
    body = MatchedBody(
        id=1, name="cart", role="obstacle", position=[1.0, 0.0, 4.0],
        velocity=[0.5, 0.0, 0.0], speed=0.5, size=[2.0, 0.4, 1.0], yaw=np.pi / 2,
    )  # fmt: skip
    scene = decoded(topics.TRUE_SCENE, foxglove.scene(drawn_truth([body]), 7))
    line = scene.entities[0].lines[0]
    turn = line.pose.orientation
    pose = Pose.from_quaternion((turn.w, turn.x, turn.y, turn.z), (1.0, 0.0, 4.0))
    points = pose.apply([[p.x, p.y, p.z] for p in line.points])
    # It heads to the right, so its length lies along x.
    np.testing.assert_allclose(np.ptp(points, axis=0), [2.0, 1.0, 0.4], atol=1e-9)
    assert len(points) == 12 * 2 * foxglove._DASHES


def test_the_edges_of_a_box_are_published_as_points() -> None:
    size, place, quarter = (0.6, 1.6, 0.4), (1.0, -0.8, 3.0), (0.5**0.5, 0.0, 0.5**0.5, 0.0)
    body = DrawnBody(
        "obstacle", 3, "3", place, quarter, size, (0.0, 0.0, 0.0), (1.0, 0.5, 0.0, 0.4), "#3"
    )
    told = decoded(topics.EDGES, foxglove.box_edges([body, body], 7))
    assert told.frame_id == "world"
    assert [field.name for field in told.fields][:4] == ["x", "y", "z", "red"]
    packed = np.frombuffer(told.data, dtype=[("at", "<f4", 3), ("rgba", "u1", 4)])
    assert told.point_stride == packed.itemsize
    assert (packed["rgba"][:, :3] == (255, 127, 0)).all()
    one, other = np.array_split(packed["at"].astype(float), 2)
    np.testing.assert_array_equal(one, other)
    local = Pose.from_quaternion(quarter, place).inverse().apply(one) / size
    # On an edge two of the three coordinates are at the border.
    at_border = np.isclose(np.abs(local), 0.5, atol=1e-5)
    assert (at_border.sum(axis=1) >= 2).all()
    assert (np.abs(local) < 0.5 + 1e-5).all()
    np.testing.assert_allclose(local.min(axis=0), -0.5, atol=1e-5)
    assert not decoded(topics.EDGES, foxglove.box_edges([], 7)).data
    unknown = replace(body, size=(np.nan, np.nan, np.nan), true=True)
    assert not decoded(topics.TRUE_EDGES, foxglove.box_edges([unknown], 7)).data
