"""Truth of the simulated lab, and its export."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from observer.calibration.formats.opencv_file import read_noted_calibration
from observer.camera import StereoCalibration
from observer.errors import InputError
from observer.geometry import Float64Array
from observer.opening import open_source
from observer.simulation.export import export_stereo_folder
from observer.simulation.scenarios import load_scenario, scenario_from_text
from observer.simulation.source import SimulatedSource
from observer.simulation.truth import SimulatedTruth
from observer.simulation.visibility import cast, visible_parts
from observer.simulation.world import World
from observer.truth.csv_file import CsvTruth

from .pixel_truth import left_hits, left_rays, render_depth

PLAIN = """
title: Plain
help: One robot, nothing else.
declares: ideal
duration_s: 4
frame_rate: 10
camera: {tilt_deg: 0, forward_m: 0.1, height_m: 0.4}
room: {x: [-2, 6], y: [-3, 3]}
"""
AHEAD = "robots:\n  - {x: 3, y: 0.06, heading_deg: 0, size: [0.5, 0.4, 0.3]}\n"


def share(world: World, time: float = 0.0, obstacle: int = 0) -> float:
    return visible_parts(world, time)[world.obstacles[obstacle].id].share


def truth_of(text: str) -> SimulatedTruth:
    return SimulatedTruth(World(scenario_from_text(text, "plain")))


def test_positions_and_headings_in_the_cameras_axes() -> None:
    observer, robot = truth_of(PLAIN + AHEAD).bodies(0.0)
    assert (observer.role, robot.role) == ("observer", "obstacle")
    # The left camera is 0.1 m ahead and 0.06 m left of the observer's centre, 0.4 m up.
    assert robot.position == pytest.approx([0, 0.4 - 0.15, 2.9], abs=1e-12)
    assert observer.position == pytest.approx([0.06, 0.4 - 0.075, -0.1], abs=1e-12)
    assert robot.yaw == pytest.approx(0)
    assert robot.size == pytest.approx([0.5, 0.4, 0.3])
    assert (robot.speed, robot.commanded_speed) == (0, 0)
    to_the_right = truth_of(PLAIN + AHEAD.replace("heading_deg: 0", "heading_deg: -90"))
    assert to_the_right.bodies(0.0)[1].yaw == pytest.approx(math.pi / 2)


@pytest.mark.parametrize("name", ["lab", "turning", "crossing", "flight", "distorted_tilted"])
def test_velocities_are_finite_differences_of_positions(name: str) -> None:
    truth = SimulatedTruth(World(load_scenario(name), 2))
    h = 1e-5
    moved = False
    for t in (0.513, 2.137, 5.291):
        now = truth.bodies(t)
        for body, a, b in zip(now, truth.bodies(t - h), truth.bodies(t + h), strict=True):
            assert (b.position - a.position) / (2 * h) == pytest.approx(body.velocity, abs=1e-5)
            moved = moved or body.speed > 0.1
    assert moved


def test_the_camera_pose_agrees_with_the_observer() -> None:
    world = World(load_scenario("turning"))
    truth = SimulatedTruth(world)
    assert truth.camera_pose(0.0).matrix == pytest.approx(np.eye(4), abs=1e-12)
    # A static point stays where it is, seen through the moving camera.
    fixed = world.posters[0].vertices[0]
    first = world.T_room_left(0.0).inverse().apply(fixed)
    for t in (1.0, 4.5):
        seen = world.T_room_left(t).inverse().apply(fixed)
        assert truth.camera_pose(t).apply(seen) == pytest.approx(first, abs=1e-9)
    # The camera is fixed to the observer.
    offset = [truth.camera_pose(t).inverse().apply(truth.bodies(t)[0].position) for t in (0.0, 3.3)]
    assert offset[0] == pytest.approx(offset[1], abs=1e-9)


def test_the_world_of_a_distorted_rig_is_its_rectified_camera() -> None:
    """Points triangulated from the rectified pair lie where the truth says."""
    world = World(load_scenario("distorted_tilted"))
    truth = SimulatedTruth(world)
    c = world.calibration
    assert not c.is_rectified
    body = world.obstacles[0]
    t = 2.0
    centre = body.T_room_body(t).apply(body.centre)
    R1, R2, P1, P2 = cv2.stereoRectify(
        c.K1, c.D1, c.K2, c.D2, (c.width, c.height), c.R, c.T, alpha=0
    )[:4]
    rectified = []
    for T_room_camera, K, D, R, P in (
        (world.T_room_left(t), c.K1, c.D1, R1, P1),
        (world.T_room_right(t), c.K2, c.D2, R2, P2),
    ):
        point = T_room_camera.inverse().apply(centre)
        raw = cv2.projectPoints(point[None], np.zeros(3), np.zeros(3), K, D)[0]
        rectified.append(cv2.undistortPoints(raw, K, D, R=R, P=P)[0, 0])
    assert rectified[0][1] == pytest.approx(rectified[1][1], abs=1e-3)
    homogeneous = cv2.triangulatePoints(P1, P2, rectified[0], rectified[1])[:, 0]
    in_camera = homogeneous[:3] / homogeneous[3]
    in_world = truth.camera_pose(t).apply(in_camera)
    assert in_world == pytest.approx(truth.bodies(t)[1].position, abs=2e-3)


def test_visible_share_by_construction() -> None:
    world = World(scenario_from_text(PLAIN + AHEAD, "plain"))
    assert share(world) == 1.0
    # Half of it is outside the image: its centre lies on the left edge's ray.
    edge = math.tan(math.radians(30)) * 2.9
    half = AHEAD.replace("y: 0.06", f"y: {0.06 + edge}").replace(
        "size: [0.5, 0.4, 0.3]", "size: [0.02, 0.4, 0.237]"
    )
    world = World(scenario_from_text(PLAIN + half, "half"))
    assert share(world) == pytest.approx(0.5, abs=0.06)
    behind = World(scenario_from_text(PLAIN + AHEAD.replace("x: 3", "x: -1"), "behind"))
    assert share(behind) == 0.0
    hidden = AHEAD + "objects:\n  - {kind: crate, x: 2, y: 0.06, size: [0.4, 1.2, 0.8]}\n"
    world = World(scenario_from_text(PLAIN + hidden, "hidden"))
    assert share(world) == 0.0


def test_visible_share_agrees_with_counted_pixels() -> None:
    world = World(load_scenario("crossing"))
    far = world.obstacles[1]
    alone = World(
        world.scenario.model_copy(update={"robots": (world.scenario.robots[1],), "objects": ()})
    )
    shares = []
    for k in range(9):
        t = 1.0 + k * 0.4
        seen = (left_hits(world, t).body == far.id).sum()
        whole = (left_hits(alone, t).body == alone.obstacles[0].id).sum()
        shares.append(share(world, t, 1))
        assert shares[-1] == pytest.approx(seen / whole, abs=0.03)
    assert min(shares) < 0.3
    assert max(shares) > 0.95


def bodies_in_the_rectified_image(world: World, time: float) -> NDArray[np.int64]:
    """Return (H, W) the body shown by each pixel of the rectified left image."""
    c, true = world.calibration, world.true_calibration
    raw = np.stack(np.meshgrid(np.arange(c.width), np.arange(c.height)), axis=-1).astype(float)
    if not c.is_rectified:
        size = (c.width, c.height)
        R1, _, P1, *_ = cv2.stereoRectify(c.K1, c.D1, c.K2, c.D2, size, c.R, c.T, alpha=0)
        maps = cv2.initUndistortRectifyMap(c.K1, c.D1, R1, P1, size, cv2.CV_32FC1)
        raw = np.stack(maps, axis=-1).astype(float)
    flat = cv2.undistortPoints(raw.reshape(-1, 1, 2), true.K1, true.D1)
    rays = np.asarray(flat, np.float64).reshape(raw.shape)
    return cast(world, world.T_room_left(time).inverse(), rays, time).body


def box_around(mask: ArrayLike) -> Float64Array:
    v, u = np.nonzero(np.asarray(mask))
    return np.array([u.min() - 0.5, v.min() - 0.5, u.max() + 0.5, v.max() + 0.5])


@pytest.mark.parametrize(
    "name",
    ["crossing", "distorted_tilted", "miscalibrated", "toward", "people", "people_meeting",
     "people_near", "people_standing", "people_carrying"],
)  # fmt: skip
def test_the_box_encloses_the_pixels_that_show_a_body(name: str) -> None:
    """In the rectified image, occluded or at the border, to about 2 px or 3 % of the side.

    Slivers hardly wider than a pixel may be inside the box or not.
    """
    world = World(load_scenario(name), 5)
    compared = 0
    for time in np.linspace(0.4, world.scenario.duration_s - 0.4, 11):
        shown = bodies_in_the_rectified_image(world, time)
        for number, part in visible_parts(world, time).items():
            mask = (shown == number).astype(np.uint8)
            broad = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
            if broad.sum() < 100 or part.share < 0.1:
                continue
            assert part.box_px is not None
            outer, inner = box_around(mask), box_around(broad)
            tolerance = np.maximum(2.5, 0.03 * np.tile(outer[2:] - outer[:2], 2))
            least, most = np.minimum(outer, inner) - tolerance, np.maximum(outer, inner) + tolerance
            assert ((least <= part.box_px) & (part.box_px <= most)).all(), (time, number, part)
            compared += 1
    assert compared >= 5


def test_the_box_by_construction() -> None:
    world = World(scenario_from_text(PLAIN + AHEAD, "plain"))
    (part,) = visible_parts(world, 0.0).values()
    assert part.box_px is not None
    u0, _, u1, v1 = part.box_px
    # 0.4 m wide and tapered, its rear 2.65 m ahead, the floor 0.4 m below the camera.
    focal = 256 / math.tan(math.radians(30))
    assert 0.9 < (u1 - u0) / (0.4 / 2.65 * focal) <= 1.0
    assert (u0 + u1) / 2 == pytest.approx(255.5, abs=0.3)
    assert v1 < 127.5 + 0.4 / 2.65 * focal
    # A crate in front of its left half hides that half.
    crate = "objects:\n  - {kind: crate, x: 1.5, y: 0.56, size: [0.2, 1.0, 1.2]}\n"
    (half,) = visible_parts(World(scenario_from_text(PLAIN + AHEAD + crate, "half")), 0.0).values()
    assert half.box_px is not None
    assert half.box_px[0] == pytest.approx(255.5, abs=2.0)
    assert half.box_px[2] == u1
    behind = World(scenario_from_text(PLAIN + AHEAD.replace("x: 3", "x: -1"), "behind"))
    assert [p.box_px for p in visible_parts(behind, 0.0).values()] == [None]


def test_the_observer_has_no_box_and_robots_are_of_kind_robot() -> None:
    observer, robot = truth_of(PLAIN + AHEAD).bodies(0.0)
    assert (observer.box_px, observer.kind, robot.kind) == (None, "robot", "robot")


def test_the_true_box_encloses_what_the_images_show() -> None:
    """The depth at the robot's pixels, transformed to the world, fills the robot's box."""
    world = World(load_scenario("lab"))
    truth = SimulatedTruth(world)
    t = 3.0
    robot = truth.bodies(t)[1]
    rays = left_rays(world)
    mask = left_hits(world, t).body == robot.id
    points = np.concatenate([rays, np.ones((*mask.shape, 1))], axis=-1)
    points = truth.camera_pose(t).apply(points * render_depth(world, t)[..., None])[mask]
    assert len(points) > 1000
    offset = points - robot.position
    down = world.T_world_room.rotate(np.array([0, 0, -1.0]))
    forward = world.T_world_room.rotate(
        world.obstacles[0].T_room_body(t).rotate(np.array([1.0, 0, 0]))
    )
    aside = np.cross(down, forward)
    for axis, size in ((forward, robot.size[0]), (aside, robot.size[1]), (down, robot.size[2])):
        extent = offset @ axis
        assert np.abs(extent).max() <= size / 2 + 1e-9
    assert (offset @ down).max() > 0.45 * robot.size[2]


def test_a_source_is_read_to_its_end_and_again_after_rewinding() -> None:
    source = SimulatedSource(World(scenario_from_text(PLAIN, "plain"), 0))
    info = source.info
    assert info.frame_count == 40
    assert info.frame_rate == 10
    assert (info.mount_height_m, info.mount_tilt_rad) == (0.4, 0.0)
    frames = []
    while (frame := source.read()) is not None:
        frames.append(frame)
    assert [f.index for f in frames] == list(range(40))
    assert frames[7].time == 0.7
    assert source.read() is None
    source.rewind()
    again = source.read()
    assert again is not None
    assert np.array_equal(again.left, frames[0].left)
    source.close()
    source.close()


def test_the_lab_opens_by_its_spec_and_its_frames_carry_no_truth() -> None:
    opened = open_source("simulated:lab?seed=3")
    assert opened.source.info.spec == "simulated:lab?seed=3"
    assert opened.truth is not None
    frame = opened.source.read()
    told = {"index", "time", "left", "right", "received", "right_time", "odometry"}
    assert set(vars(frame)) == told
    assert isinstance(opened.source.calibration, StereoCalibration)
    assert opened.source.calibration.is_rectified


def test_export_writes_a_complete_stereo_folder(tmp_path: Path) -> None:
    scenario = tmp_path / "short.yaml"
    scenario.write_text("based_on: lateral\nduration_s: 0.4\n", encoding="utf-8")
    output = tmp_path / "made" / "here"
    steps: list[tuple[int, int]] = []
    count = export_stereo_folder(
        str(scenario), 1, output, lambda done, total: steps.append((done, total))
    )
    assert count == 6
    assert steps == [(k + 1, 6) for k in range(6)]
    names = sorted(p.name for p in (output / "left").iterdir())
    assert names == sorted(p.name for p in (output / "right").iterdir())
    assert len(names) == 6
    times = [float(line) for line in (output / "times.txt").read_text().splitlines()]
    assert times == pytest.approx([k / 15 for k in range(6)], abs=1e-8)
    world = World(load_scenario(str(scenario)), 1)
    frame = SimulatedSource(world).read()
    assert frame is not None
    assert np.array_equal(cv2.imread(str(output / "left" / names[0])), frame.left)
    calibration = read_noted_calibration(output / "calibration.yaml")[0]
    assert np.array_equal(calibration.K1, world.calibration.K1)
    assert calibration.is_rectified
    written, made = CsvTruth(output / "truth.csv"), SimulatedTruth(world)
    header = (output / "truth.csv").read_text().splitlines()[0]
    assert header.startswith(
        "frame,t,id,x,y,z,vx,vy,vz,visible,size_x,size_y,size_z,yaw,name,role,commanded_speed"
    )
    for k in (0, 5):
        for a, b in zip(written.bodies(k / 15), made.bodies(k / 15), strict=True):
            for told in ("id", "name", "role", "visible", "box_px", "kind"):
                assert getattr(a, told) == getattr(b, told), told
            assert a.position == pytest.approx(b.position, abs=1e-9)
            assert a.velocity == pytest.approx(b.velocity, abs=1e-9)


def test_export_of_uncalibrated_cameras_writes_no_calibration(tmp_path: Path) -> None:
    scenario = tmp_path / "short.yaml"
    scenario.write_text("based_on: calibration\nduration_s: 0.2\n", encoding="utf-8")
    assert export_stereo_folder(str(scenario), 0, tmp_path / "out") == 3
    written = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert written == ["left", "right", "times.txt", "truth.csv"]
    # The board is not an obstacle: the truth holds the observer alone.
    assert {b.role for b in CsvTruth(tmp_path / "out" / "truth.csv").bodies(0.0)} == {"observer"}


def test_export_refuses_a_folder_that_is_not_empty(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match="is not empty; name a new or empty one"):
        export_stereo_folder("lateral", 0, tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]
    with pytest.raises(InputError, match="is a file"):
        export_stereo_folder("lateral", 0, tmp_path / "mine.txt")


def test_the_simulation_does_not_import_the_method() -> None:
    code = (
        "import sys, observer.simulation.export, observer.simulation.source;"
        "print([m for m in sys.modules if m.startswith(('observer.stages', 'observer.observer'))])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.strip() == "[]"
