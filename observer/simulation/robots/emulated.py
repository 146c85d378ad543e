"""A whole robot of its own: firmware and vehicle on a floor, driven by the time it is told."""

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
from observer.simulation.robots.vehicle import Hull, Vehicle

# A clock that leapt farther is not made up for: the robot stood still meanwhile.
_LONGEST_S = 0.5
_BUMPERS_P3DX = 5


class EmulatedRobot:
    """One robot on a floor, as ``serving`` takes it.

    Args:
        model: of ``observer.robots.models``.
        now: the time at the start, seconds, of the clock that ``receive`` and ``tick`` tell.
        around: what is on the floor; an endless empty one unless given.
        watchdog_s, subtype: as ``Firmware`` takes them.
        seed: of the wheels' errors; None for wheels that count exactly.

    Attributes:
        firmware, vehicle: its two halves. ``firmware.odometry`` is what the status packets are
            rounded from.
        around: may be replaced while it runs.

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
        hull = Hull(spec.length_m, spec.width_m, bumpers, bumpers)
        self.vehicle = Vehicle(spec, hull, PlanarState(0.0, 0.0, 0.0), seed=seed)
        self.around = around or Surroundings()
        self._now = now
        self.firmware = Firmware(
            spec, self, now=now, name=f"emulated {spec.title}", subtype=subtype,
            watchdog_s=watchdog_s, front_bumpers=bumpers, rear_bumpers=bumpers,
        )  # fmt: skip

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
        """What it answers to these bytes at once."""
        return self.firmware.receive(data, now)

    def tick(self, now: float) -> bytes:
        """Let time pass up to ``now``; what it sends by itself."""
        self.vehicle.advance(min(now - self._now, _LONGEST_S), self.around)
        self._now = max(self._now, now)
        return self.firmware.tick(now)

    def cut_off(self) -> None:
        """Its client is gone."""
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
        """How fast it truly is, whichever way."""
        state = self.vehicle.state
        return math.hypot(state.vx, state.vy)


def bumpers_of(model: str) -> int:
    """How many bumpers a model has at each end here."""
    return _BUMPERS_P3DX if model.startswith("p3dx") else 0
