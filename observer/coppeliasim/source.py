"""The vision sensors of a CoppeliaSim scene as a source of stereo frames.

The source is paced like a recording, not live: the simulator stands still until the next frame is
read, so the source can be paused and stepped. It never ends by itself.
"""

from __future__ import annotations

import time as clock
from dataclasses import replace

from observer.coppeliasim.connection import ANSWER_WITHIN_S, Connection, CoppeliaSimError
from observer.coppeliasim.noise import noisy
from observer.coppeliasim.pioneers import Pioneer, WheelOdometry
from observer.coppeliasim.sensors import StereoSensors
from observer.coppeliasim.simulation import Simulation
from observer.coppeliasim.truth import CoppeliaSimTruth
from observer.geometry import Pose
from observer.mount import CameraMount
from observer.sources.contract import SourceInfo
from observer.types import StereoFrame

_EXPLICITLY_HANDLED = 1
# Seconds: for the first image the simulator may have to prepare its renderer.
_FIRST_IMAGE_WITHIN_S = 5.0


class CoppeliaSimSource:
    """Frames of a scene, one for each step; a frame's time is the simulated time.

    Args:
        robot: the one that carries the sensors, if any.
        truth: records the scene's state at every frame.

    Attributes:
        calibration: exact, from the sensors' resolution, view angle and poses.

    Raises:
        CoppeliaSimError: the simulation cannot be started or stepped.
    """

    def __init__(
        self,
        connection: Connection,
        sensors: StereoSensors,
        robot: Pioneer | None,
        truth: CoppeliaSimTruth,
    ) -> None:
        self._connection = connection
        self._sensors = sensors
        self.calibration = sensors.calibration
        self._robot = robot
        self._truth = truth
        self._simulation = Simulation(connection)
        self._odometry = _odometry(robot)
        self._next = 0
        self.info = self._described()
        self._begin()

    def read(self) -> StereoFrame:
        """Step and read the frame; stepping first lets it show the effect of earlier commands.

        Raises:
            CoppeliaSimError: the simulator does not answer, or not as expected.
        """
        if self._next:
            self._simulation.step()
        for _ in range(2):
            frame = self._read_here()
            if frame is not None:
                self._next += 1
                return frame
            # The simulator forgot that we step it, and continued by itself.
            self._simulation.hold_again()
        raise CoppeliaSimError(
            f"CoppeliaSim at {self._connection.address} advances by itself while it is being read; "
            "check that no other program switches its stepping mode"
        )

    def rewind(self) -> None:
        """Restart the simulation."""
        self._simulation.restart()
        self._truth.begin_again()
        self._odometry = _odometry(self._robot)
        self._next = 0
        self._begin()

    def close(self) -> None:
        """Release the simulator; stop the simulation if it was started here."""
        self._simulation.close()
        self._connection.close()

    def _begin(self) -> None:
        for sensor in (self._sensors.left, self._sensors.right):
            self._connection.call("setExplicitHandling", sensor.handle, _EXPLICITLY_HANDLED)
        self._simulation.start()
        self._draw(within_s=_FIRST_IMAGE_WITHIN_S)

    def _draw(self, *, within_s: float = ANSWER_WITHIN_S) -> None:
        for sensor in (self._sensors.left, self._sensors.right):
            self._connection.call("handleVisionSensor", sensor.handle, within_s=within_s)

    def _read_here(self) -> StereoFrame | None:
        """Read everything of one instant; None if the time changed meanwhile."""
        before = self._simulation.time
        self._draw()
        left, right = (
            noisy(sensor.image(self._connection), self._next, side)
            for side, sensor in enumerate((self._sensors.left, self._sensors.right))
        )
        self._truth.note(self._connection, before, self._T_room_left())
        odometry = None
        if self._robot is not None and self._odometry is not None:
            odometry = self._odometry.add(*self._robot.wheel_angles(self._connection))
        if self._simulation.time != before:
            return None
        return StereoFrame(
            index=self._next,
            time=before,
            left=left,
            right=right,
            received=clock.monotonic(),
            odometry=odometry,
        )

    def _described(self) -> SourceInfo:
        mount = self._mount()
        calibration = self._sensors.calibration
        info = SourceInfo(
            spec=self._connection.address.world,
            kind="coppeliasim",
            width=calibration.width,
            height=calibration.height,
            frame_rate=1 / self._simulation.time_step_s,
            frame_count=None,
        )
        if mount is None:
            return info
        return replace(
            info,
            mount_height_m=mount.height_m,
            mount_tilt_rad=mount.tilt_rad,
            mount_forward_m=mount.forward_m,
            mount_left_m=mount.left_m,
        )

    def _mount(self) -> CameraMount | None:
        """Mount of the left sensor on its robot; None if there is no valid one."""
        if self._robot is None:
            return None
        T_room_base = self._robot.T_room_base(self._connection)
        T_base_camera = T_room_base.inverse() @ self._T_room_left()
        down = T_base_camera.inverse().rotate([0.0, 0.0, -1.0])
        tilt, _ = CameraMount.angles_of(down)
        forward, left, height = T_base_camera.translation.tolist()
        try:
            return CameraMount(height, tilt, forward, left)
        except ValueError:
            return None

    def _T_room_left(self) -> Pose:
        return self._sensors.left.T_room_camera(self._connection)


def _odometry(robot: Pioneer | None) -> WheelOdometry | None:
    return None if robot is None else WheelOdometry(robot.wheel_radius_m, robot.track_m)
