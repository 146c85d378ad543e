"""``evaluate`` against motion capture with a clock and a world frame of its own."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from observer.geometry import Pose
from observer.truth.alignment.camera_on_body import CameraOnBody
from observer.truth.contract import TrueBody
from observer.truth.csv_file import write_truth_csv
from observer.truth.sampled import TruthSample

from ...observer.truth.alignment.conftest import Room, make_room
from ..engine_values import rectified_calibration
from .shell import Shell

OFFSET_S = 0.3


@pytest.fixture
def room() -> Room:
    return make_room(3, offset=OFFSET_S, noise=0.002)


@pytest.fixture
def tracks(room: Room, tmp_path: Path) -> Path:
    lines = [line | {"status": "ok"} for line in room.lines]
    seen = [(line["time"], each) for line in lines for each in line["obstacles"]]
    times = np.array([time for time, _ in seen])
    velocities = np.gradient(np.array([each["position"] for _, each in seen]), times, axis=0)
    for (_, each), velocity in zip(seen, velocities, strict=True):
        each |= {"velocity": velocity.tolist(), "velocity_cov": None}
    path = tmp_path / "tracks.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


@pytest.fixture
def mocap(room: Room, tmp_path: Path) -> Path:
    rows = ["body,t,x,y,z,qx,qy,qz,qw"]
    for name, body in room.capture.bodies.items():
        assert body.rotations is not None
        for t, place, R in zip(body.times, body.positions, body.rotations, strict=True):
            if np.isfinite(place).all():
                cells = [t, *place, *Rotation.from_matrix(R).as_quat()]
                rows.append(",".join([name, *(f"{cell:.6f}" for cell in cells)]))
    path = tmp_path / "anything.txt"
    path.write_text("\n".join(rows) + "\n")
    return path


def test_motion_capture_is_aligned_before_comparison(
    shell: Shell, room: Room, tracks: Path, mocap: Path
) -> None:
    done = shell("evaluate", str(tracks), "--truth", str(mocap), "--json")
    assert done.code == 0, done.err
    found = json.loads(done.out)
    assert found["alignment"]["time"]["offset_s"] == pytest.approx(OFFSET_S, abs=0.02)
    assert found["alignment"]["roles"] == {"Amigo": "observer", "P3DX": "obstacle"}
    assert found["recall"] > 0.9
    assert found["speed_rmse_mps"] < 0.1
    assert "time offset +" in done.err
    assert "assigned to the observer" in done.err

    typed = CameraOnBody.of_pose(room.T_body_camera)
    words = ["evaluate", str(tracks), "--truth", str(mocap), "--json", "--observer", "Amigo"]
    done = shell(*words, f"--camera-on-body={typed}")
    assert done.code == 0, done.err
    camera = np.array(json.loads(done.out)["alignment"]["T_body_camera"])
    np.testing.assert_allclose(camera, typed.T_body_camera.matrix, atol=0.02)
    refused = shell(*words, "--camera-on-body=0.1,0.2")
    assert refused.code == 2
    assert "X,Y,Z,PAN,TILT,ROLL in metres and degrees" in refused.err


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--observer", "Turtle"), "motion capture has no body 'Turtle'"),
        (("--observer", "P3DX", "--ignore", "P3DX"), "cannot be both"),
    ],
)
def test_an_unknown_body_is_named(
    shell: Shell, tracks: Path, mocap: Path, options: tuple[str, ...], says: str
) -> None:
    done = shell("evaluate", str(tracks), "--truth", str(mocap), *options)
    assert done.code == 2
    assert says in done.err
    assert done.out == ""


def test_the_size_of_the_images_is_that_of_the_calibration_beside_the_truth(
    shell: Shell, tmp_path: Path
) -> None:
    times = [k / 10 for k in range(20)]
    bodies = [
        TrueBody(
            id=1, name="person", role="obstacle", position=np.array([0.4 * t, 0.0, 1.0]),
            velocity=np.array([0.4, 0.0, 0.0]), size=np.array([0.5, 1.8, 0.3]), yaw=0.0,
            visible=0.2, commanded_speed=None, box_px=(0.0, 0.0, 200.0, 255.0),
        )
        for t in times
    ]  # fmt: skip
    frames = enumerate(zip(times, bodies, strict=True))
    write_truth_csv(
        tmp_path / "truth.csv",
        [TruthSample(k, t, (body,), Pose.identity()) for k, (t, body) in frames],
    )
    pose = {"position": [0, 0, 0], "orientation_wxyz": [1, 0, 0, 0]}
    lines = [
        {"frame": k, "time": t, "segment": 0, "status": "ok", "pose": pose, "obstacles": []}
        for k, t in enumerate(times)
    ]
    tracks = tmp_path / "tracks.jsonl"
    tracks.write_text("".join(json.dumps(line) + "\n" for line in lines))
    words = ("evaluate", str(tracks), "--truth", str(tmp_path / "truth.csv"), "--json")
    without = shell(*words)
    assert "the image size is unknown" in without.err
    assert json.loads(without.out)["truth_count"] == 0
    (tmp_path / "calibration.yaml").write_text(rectified_calibration())
    done = shell(*words)
    assert (done.code, done.err) == (0, "")
    # The person fills more than a tenth of the image, so they count after 0.6 s.
    assert json.loads(done.out)["truth_count"] == 14
