"""The whole system, cameras, server, robot and operator, and setting it in motion."""

from __future__ import annotations

import math
import random
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from observer.calibration.formats.opencv_file import calibration_text
from observer.simulation.robots.emulated import EmulatedRobot
from observer.simulation.robots.serving import Serving, serve_tcp
from observer.simulation.world import World

from .bench import Server, served, wait_until
from .cameras import Camera, stereo_cameras, still_world
from .operator import Operator, arm

SPEED_MPS = 0.3
# Speed regarded as moving, given the ramp and slow status packets.
MOVING_MPS = 0.27
_PATIENCE_S = 60.0
_RIG = """mount: {{height_m: {height}, tilt_deg: {tilt}, forward_m: {forward}, left_m: {left}}}
models: {{observer: amigo-sh}}
ports: {{observer: '{port}'}}
"""


class System:
    """A lab in which faults are injected.

    Args:
        folder: for the data. environment: variables for the server's processes, beside our own.

    Attributes:
        left, right: cameras. robot: behind its port. server: restarted by ``restart``.
        folder: of the data.
    """

    def __init__(self, folder: Path, environment: Mapping[str, str] | None = None) -> None:
        self.world: World = still_world()
        self.left: Camera
        self.right: Camera
        self.left, self.right, self._calibration = stereo_cameras(self.world)
        robot = EmulatedRobot("amigo-sh", now=time.monotonic())
        self.robot: Serving[EmulatedRobot] = serve_tcp(robot)
        self.server: Server
        self.operator: Operator | None = None
        self.folder = folder
        self._environment = environment
        self._serving = ExitStack()
        self._calibration_id: str | None = None
        self.random = random.Random(7)

    # --- life ------------------------------------------------------------------------------

    def start(self) -> None:
        """Start the server on the existing data."""
        self.server = self._serving.enter_context(
            served(self.folder, self.source, self._environment)
        )
        if self._calibration_id is None:
            text = calibration_text(self._calibration).encode()
            kept = self.server.upload("/calibrations", "calibration.yaml", text)
            self._calibration_id = kept["id"]
        self.server.request(
            "PUT", "/source", {"source": self.source, "calibration": self._calibration_id}
        )
        # Faster acceleration allows more trials.
        self.server.request("PATCH", "/parameters", {"guard.acceleration_mps2": 3.0})
        self.wait_for_sight()

    def end(self) -> None:
        """Stop the server, whatever its state."""
        self.leave()
        self._serving.close()

    @contextmanager
    def running(self) -> Iterator[System]:
        """Run with everything at work."""
        self.folder.mkdir(parents=True, exist_ok=True)
        camera = self.world.scenario.camera
        rig = _RIG.format(
            height=camera.height_m,
            tilt=camera.tilt_deg,
            forward=camera.forward_m,
            left=camera.baseline_m / 2,
            port=self.robot.port,
        )
        (self.folder / "rig.yaml").write_text(rig)
        with self.left, self.right, self.robot:
            try:
                self.start()
                yield self
            finally:
                self.end()

    @property
    def source(self) -> str:
        return f"{self.left.url},{self.right.url}"

    # --- the operator ----------------------------------------------------------------------

    def sit_down(self) -> Operator:
        """Return the operator at the page, opening it if needed."""
        if self.operator is None:
            self.operator = Operator(self.server.port, self.server.token)
        return self.operator

    def leave(self, *, abruptly: bool = False) -> None:
        """Close the operator's page."""
        operator, self.operator = self.operator, None
        if operator is not None:
            operator.leave(abruptly=abruptly)

    def wait_for_sight(self, timeout_s: float = 20.0) -> None:
        """Wait until the drive process sees and the robot is connected."""

        facts: dict[str, Any] = {}

        def sees() -> bool:
            facts.update(self.server.request("GET", "/robots"))
            robot, sight = facts["robots"]["observer"], facts["sight"]
            if robot is None or robot["state"] in ("connecting", "waiting", "refused"):
                return False
            return sight["status"] == "ok" and (sight["age_s"] or 9) < 0.2

        try:
            wait_until("sight and a connected robot", sees, timeout_s)
        except AssertionError as error:
            raise AssertionError(f"{error}: {facts}") from None

    def move(self) -> None:
        """Bring the robot to ``SPEED_MPS``, whatever its state, then wait for a random phase."""
        self.left.behave()
        self.right.behave()
        self.wait_for_sight()
        operator = self.sit_down()
        operator.mute = False
        if operator.lease is None:
            assert operator.take(takeover=True)["state"] == "yours", operator.messages
        deadline = time.monotonic() + _PATIENCE_S
        while not self._drive_off(operator):
            # On a busy machine a frame or a command is occasionally late, which stops the robot.
            facts, said = self.server.robot(), operator.messages[-3:]
            assert time.monotonic() < deadline, f"the robot does not move: {facts}; {said}"
        time.sleep(self.random.uniform(0.0, 0.15))

    def _drive_off(self, operator: Operator) -> bool:
        """Press the key; return whether the robot drives soon."""
        operator.release()
        # It may still be rolling from the previous trial, which is not driving.
        wait_until("the robot stands", lambda: self.robot.robot.speed_mps < 0.01)
        arm(self.server, operator)
        operator.hold(SPEED_MPS)
        until = time.monotonic() + 2.5
        while self.robot.robot.speed_mps < MOVING_MPS:
            if time.monotonic() > until:
                return False
            time.sleep(0.01)
        return True

    # --- the stopwatch ---------------------------------------------------------------------

    def zero_after(self, cause: float, patience_s: float = 2.0) -> float:
        """Return the seconds from ``cause`` to the first zero velocity on the robot's port.

        Infinite if none came.
        """
        log = self.robot.robot.log
        deadline = time.monotonic() + patience_s
        while (zero := log.first_standing(cause)) is None:
            if time.monotonic() > deadline:
                return math.inf
            time.sleep(0.005)
        return zero.time - cause

    def moves_since(self, time_: float) -> list[Any]:
        """Return the commands since then that ask for motion."""
        return [each for each in self.robot.robot.log.since(time_) if not each.is_standstill]
