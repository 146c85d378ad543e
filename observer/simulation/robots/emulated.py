"""A complete robot: firmware and vehicle on a floor, stepped by the times it is given."""

from __future__ import annotations

import math

from observer.robots.models import robot_spec
from observer.simulation.motion import PlanarState
from observer.simulation.robots.chassis import Drive, Wheels
from observer.simulation.robots.command_log import CommandLog
from observer.simulation.robots.faults import Faults
from observer.simulation.robots.firmware import WATCHDOG_S, Firmware
from observer.simulation.robots.floor import Surroundings
from observer.simulation.robots.sonar import sonar_range
from observer.simulation.robots.vehicle import Vehicle

# A longer leap of the clock is not made up for: the robot stood still meanwhile.
_LONGEST_S = 0.5
_BUMPERS_P3DX = 5


class EmulatedRobot:
    """One robot on a floor, to be served by ``serving``.

    Args:
        model: of ``observer.robots.models``.
        now: start time in seconds, on the clock of ``receive`` and ``tick``.
        around: what stands on the floor; endless and empty unless given.
        watchdog_s, subtype: see ``Firmware``.
        seed: of the wheels' errors; None for exact wheels.

    Attributes:
        firmware, vehicle: its two halves. The status packets round ``firmware.odometry``.
        around: may be replaced while the robot runs.

    Raises:
        InputError: there is no such model.
    """

    def __init__(
        self,
        model: str,
        *,
        now: float = 0.0,
        around: Surroundings | None = None,
        watchdog_s: float = WATCHDOG_S,
        subtype: str | None = None,
        seed: int | None = None,
    ) -> None:
        spec = robot_spec(model)
        bumpers = bumpers_of(model)
        size = spec.length_m, spec.width_m
        state = PlanarState(0.0, 0.0, 0.0)
        self.vehicle = Vehicle(spec, size, state, bumpers=bumpers, seed=seed)
        self.around = around or Surroundings()
        self._now = now
        self.firmware = Firmware(
            spec,
            self,
            now=now,
            name=f"emulated {spec.title}",
            subtype=subtype,
            watchdog_s=watchdog_s,
            bumpers=bumpers,
        )

    @property
    def log(self) -> CommandLog:
        return self.firmware.log

    @property
    def faults(self) -> Faults:
        return self.firmware.faults

    @property
    def baud(self) -> int:
        return self.firmware.baud

    def receive(self, data: bytes, now: float) -> bytes:
        """Take received bytes; return the immediate answer."""
        return self.firmware.receive(data, now)

    def tick(self, now: float) -> bytes:
        """Let time pass up to ``now``; return what the robot sends by itself."""
        self.vehicle.advance(min(now - self._now, _LONGEST_S), self.around)
        self._now = max(self._now, now)
        return self.firmware.tick(now)

    def cut_off(self) -> None:
        """Note that the client is gone."""
        self.firmware.cut_off()

    # ------------------------------------------------------------------ as Chassis

    def drive(self, drive: Drive) -> None:
        self.vehicle.drive = drive

    def wheels(self) -> Wheels:
        return self.vehicle.wheels()

    def sonar(self, index: int) -> float | None:
        pose = self.firmware.spec.sonars[index]
        return sonar_range(self.around.edges(), self.vehicle.state, pose)

    @property
    def speed_mps(self) -> float:
        """True speed, in any direction."""
        state = self.vehicle.state
        return math.hypot(state.vx, state.vy)


def bumpers_of(model: str) -> int:
    """Return the number of bumpers that a simulated model has at each end."""
    return _BUMPERS_P3DX if model.startswith("p3dx") else 0
