"""A complete robot: firmware and vehicle on a floor, stepped by the times passed to it."""

from __future__ import annotations

import math

from observer.robots.models import robot_spec
from observer.simulation.motion import PlanarState
from observer.simulation.robots.chassis import Drive, Wheels
from observer.simulation.robots.firmware import WATCHDOG_S, Firmware
from observer.simulation.robots.floor import Surroundings
from observer.simulation.robots.sonar import sonar_range
from observer.simulation.robots.vehicle import Vehicle

# Seconds: of a longer jump of the clock only this much is simulated.
_LONGEST_S = 0.5
_BUMPERS_P3DX = 5


class EmulatedRobot(Firmware):
    """One robot on a floor, firmware and machine, to be served by ``serving``.

    Args:
        model: of ``observer.robots.models``.
        now: start time in seconds, on the clock of ``receive`` and ``tick``.
        around: obstacles on the floor; an endless, empty floor unless given.
        watchdog_s, subtype: see ``Firmware``.
        seed: of the wheels' errors; None for exact wheels.

    Attributes:
        vehicle: the machine. Its exact odometry is ``odometry``; status packets round it.
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
        spec, bumpers = robot_spec(model), bumpers_of(model)
        size, state = (spec.length_m, spec.width_m), PlanarState(0.0, 0.0, 0.0)
        self.vehicle = Vehicle(spec, size, state, bumpers=bumpers, seed=seed)
        self.around = around or Surroundings()
        self._moved = now
        super().__init__(
            spec,
            self,
            now=now,
            name=f"emulated {spec.title}",
            subtype=subtype,
            watchdog_s=watchdog_s,
            bumpers=bumpers,
        )

    def tick(self, now: float) -> bytes:
        """Advance to ``now``; return what the robot sends unasked."""
        self.vehicle.advance(min(now - self._moved, _LONGEST_S), self.around)
        self._moved = max(self._moved, now)
        return super().tick(now)

    # ------------------------------------------------------------------ as Chassis

    def drive(self, drive: Drive) -> None:
        self.vehicle.drive = drive

    def wheels(self) -> Wheels:
        return self.vehicle.wheels()

    def sonar(self, index: int) -> float | None:
        return sonar_range(self.around.edges(), self.vehicle.state, self.spec.sonars[index])

    @property
    def speed_mps(self) -> float:
        """True speed, in any direction."""
        state = self.vehicle.state
        return math.hypot(state.vx, state.vy)


def bumpers_of(model: str) -> int:
    """Return the number of bumpers that a simulated model has at each end."""
    return _BUMPERS_P3DX if model.startswith("p3dx") else 0
