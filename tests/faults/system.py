"""Everything together: cameras, server, robot and operator, and how to bring them into motion."""

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
# What a ramp and a slow status packet leave of it.
MOVING_MPS = 0.27
_PATIENCE_S = 60.0
_RIG = """mount: {{height_m: {height}, tilt_deg: {tilt}, forward_m: {forward}, left_m: {left}}}
models: {{observer: amigo-sh}}
ports: {{observer: '{port}'}}
"""


class System:
    """A lab in which things go wrong.

    Args:
        folder: for the data. environment: of the server's processes, beside the own one.

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
        """Begin to serve, on what was kept before."""
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
        # Who has come to speed sooner can be stopped more often.
        self.server.request("PATCH", "/parameters", {"guard.acceleration_mps2": 3.0})
        self.wait_for_sight()

    def end(self) -> None:
        """Stop serving, however the server fares."""
        self.leave()
        self._serving.close()

    @contextmanager
    def running(self) -> Iterator[System]:
        """With everything at work."""
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
        """Somebody opens the page."""
        if self.operator is None:
            self.operator = Operator(self.server.port, self.server.token)
        return self.operator

    def leave(self, *, abruptly: bool = False) -> None:
        """And closes it."""
        operator, self.operator = self.operator, None
        if operator is not None:
            operator.leave(abruptly=abruptly)

    def wait_for_sight(self, timeout_s: float = 20.0) -> None:
        """Until the drive process sees and the robot is connected."""

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
        """Bring the robot to ``SPEED_MPS``, whatever happened before; at a random phase then."""
        self.left.behave()
        self.right.behave()
        self.wait_for_sight()
        operator = self.sit_down()
        operator.mute = False
        if operator.lease is None:
            assert operator.take(takeover=True)["state"] == "yours", operator.messages
        deadline = time.monotonic() + _PATIENCE_S
        while not self._drive_off(operator):
            # On a busy machine a frame or a command comes too late now and then, which stops it.
            facts, said = self.server.robot(), operator.messages[-3:]
            assert time.monotonic() < deadline, f"the robot does not move: {facts}; {said}"
        time.sleep(self.random.uniform(0.0, 0.15))

    def _drive_off(self, operator: Operator) -> bool:
        """Press the key; whether the robot drives soon."""
        operator.release()
        # It may still roll on from the trial before, which is no driving.
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
        """Seconds from an instant to the first zero velocity on the robot's port.

        Infinite where none came; from then on none but zero may come, which is looked at for a
        moment.
        """
        log = self.robot.robot.log
        deadline = time.monotonic() + patience_s
        while (zero := log.first_standing(cause)) is None:
            if time.monotonic() > deadline:
                return math.inf
            time.sleep(0.005)
        return zero.time - cause

    def moves_since(self, time_: float) -> list[Any]:
        """Commands that ask for motion."""
        return [each for each in self.robot.robot.log.since(time_) if not each.stands]
