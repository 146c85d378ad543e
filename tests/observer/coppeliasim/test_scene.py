"""The paper's scene, built through the client, and everything from there to detected obstacles."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import threading
from typing import Any

import pytest

from app.cli.coppelia_scene import coppelia_scene
from observer.coppeliasim.connection import CoppeliaSimError
from observer.coppeliasim.robot import open_coppelia_robot
from observer.coppeliasim.scene import PIONEER_MODEL, build_scene
from observer.opening import open_source
from observer.robots.contract import RobotPhase

pytestmark = pytest.mark.usefixtures("extra")


def _observe(spec: str, frames: int) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "app.cli", "observe", spec, "--frames", str(frames)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def test_a_rebuilt_scene_is_the_same_and_its_crossing_robot_is_detected(
    bare: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    outputs = []
    for _ in range(2):
        coppelia_scene(str(bare.address))
        outputs.append(capsys.readouterr().out)
    assert outputs[0] == outputs[1]
    assert f"next: dynamic-observer serve {bare.spec}" in outputs[0]
    with bare.connected() as other:
        scene = other.constant("handle_scene")
        names = [
            other.call("getObjectAlias", h)
            for h in other.call("getObjectsInTree", scene, other.constant("handle_all"), 0)
        ]
        for name, count in (
            ("PioneerP3DX", 2), ("leftCamera", 1), ("rightCamera", 1), ("dynamicObserverBox1", 1),
            ("dynamicObserverWall4", 1), ("dynamicObserverFloor", 1),
            # A texture's helper object, and the model's own script, which would drive it.
            ("Plane", 0), ("Script", 0),
        ):  # fmt: skip
            assert names.count(name) == count, name
    # Read one frame so that everything is painted; the stand-in does not answer while it paints.
    opened = open_source(bare.spec)
    opened.source.read()
    _, obstacle = opened.truth.bodies(0.0)
    opened.source.close()
    assert math.degrees(obstacle.yaw) == pytest.approx(90)
    assert obstacle.position[2] == pytest.approx(2.4, abs=0.2)
    robot = open_coppelia_robot(f"{bare.spec}/PioneerP3DX[1]")
    ended = threading.Event()

    def drive() -> None:
        while not ended.wait(0.03):
            if robot.report().phase is RobotPhase.CONNECTED:
                if not robot.report().motors_enabled:
                    robot.enable()
                robot.drive(0.4, 0.0)

    thread = threading.Thread(target=drive, daemon=True)
    thread.start()
    try:
        observed = _observe(bare.spec, 20)
    finally:
        ended.set()
        thread.join()
        robot.close()
    assert observed.returncode == 0, observed.stderr
    lines = [json.loads(line) for line in observed.stdout.splitlines()]
    assert len(lines) == 20
    speeds = [o["speed"] for line in lines[8:] for o in line["obstacles"]]
    assert len(speeds) >= 8
    assert sorted(speeds)[len(speeds) // 2] == pytest.approx(0.4, abs=0.05)


def test_a_running_simulation_and_a_missing_model_are_reported(bare: Any) -> None:
    with bare.connected() as other:
        other.call("startSimulation")
        with pytest.raises(
            CoppeliaSimError, match=r"is running, and anything built .* stop it first"
        ):
            build_scene(bare.address)
        with pytest.raises(CoppeliaSimError, match=r"File 'nothing.ttm' could not be opened"):
            other.call("loadModel", "nothing.ttm")
    assert PIONEER_MODEL == "models/robots/mobile/pioneer p3dx.ttm"
