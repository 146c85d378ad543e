"""Damaged truth.csv: finite samples in order, or a one-line refusal; written values are read."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.errors import TruthError
from observer.geometry import Pose
from observer.truth.alignment.camera_on_body import CameraOnBody
from observer.truth.contract import TrueBody
from observer.truth.csv_file import CsvTruth, write_truth_csv
from observer.truth.live.opening import check_live
from observer.truth.sampled import TruthSample

from ...damage import damaged, damaged_text, examples, hostile_text, read_or_refused


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("damage")


@pytest.fixture(scope="module")
def whole(folder: Path) -> bytes:
    body = TrueBody(
        id=1, name="cart", role="obstacle", position=np.array([1.0, 0.1, 4.0]),
        velocity=np.array([0.3, 0, 0]), size=np.array([0.4, 0.3, 0.5]), yaw=0.2, visible=0.9,
        commanded_speed=0.3, box_px=(10.0, 20.0, 50.0, 80.0), kind="robot",
    )  # fmt: skip
    pose = Pose.from_rotvec([0.1, 0.2, 0.3], [1, 2, 3])
    write_truth_csv(folder / "whole", [TruthSample(k, k / 15, (body,), pose) for k in range(6)])
    return (folder / "whole").read_bytes()


@examples(60)
@given(data=st.data())
def test_damaged_table_is_refused_or_in_order(
    folder: Path, whole: bytes, data: st.DataObject
) -> None:
    path = folder / "truth.csv"
    path.write_bytes(data.draw(damaged([whole])))
    truth = read_or_refused(lambda: CsvTruth(path), TruthError)
    if truth is None:
        return
    times = [sample.time for sample in truth.samples]
    assert times == sorted(set(times))
    for sample in truth.samples:
        assert math.isfinite(sample.time)
        for time in (sample.time, sample.time + 0.01):
            for body in truth.bodies(time):
                assert np.isfinite(np.concatenate([body.position, body.velocity, body.size])).all()
            pose = truth.camera_pose(time)
            if pose is not None:
                np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-6)


@examples(60)
@given(text=hostile_text(("1", "2", ",", "0.12,0.06,0.25,0,10,0"))
       | damaged_text(["0.12,0.06,0.25,0,10,0"]))  # fmt: skip
def test_camera_placement_text_is_a_pose_or_refused(text: str) -> None:
    camera = read_or_refused(lambda: CameraOnBody.parse(text), TruthError)
    if camera is not None:
        assert CameraOnBody.parse(str(camera)) == camera
        assert np.isfinite(camera.T_body_camera.matrix).all()


@examples(60)
@given(text=damaged_text(["vrpn:localhost:3883/robot,cart", "vicon-udp:51001", "vrpn:[::1]"])
       | hostile_text(("vrpn:", "vicon-udp:", "/")))  # fmt: skip
def test_live_truth_address_is_parsed_or_refused(text: str) -> None:
    read_or_refused(lambda: check_live(text), TruthError)
