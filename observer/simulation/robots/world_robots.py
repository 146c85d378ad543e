"""Robots of a simulated world, reached and driven like real ones.

The AmigoBot that carries the cameras is the observer, the scenario's first robot the obstacle; a
scenario without robots, as with people alone, has only the observer.
Their firmware runs on the wall clock, as a driver expects; their wheels turn on the frames'
clock, so that a slow or paused simulation stays consistent. Each follows its script until its
motors are first enabled, and from then on is driven until the source is rewound.
"""

from __future__ import annotations

import math
import threading
import time as clocks
import uuid
from collections.abc import Callable

from observer.rig.rig import RobotModel, Role
from observer.robots.contract import RobotPort
from observer.robots.models import robot_spec
from observer.simulation.robots.driven import DrivenVehicle
from observer.simulation.robots.emulated import bumpers_of
from observer.simulation.robots.firmware import Firmware
from observer.simulation.robots.floor import Outline, Surroundings, outline_at
from observer.simulation.robots.serving import Serving, serve_tcp
from observer.simulation.robots.vehicle import STEP_S
from observer.simulation.source import SimulatedSource
from observer.simulation.world import Body, World

_OBSERVER: RobotModel = "amigo-sh"
_OBSTACLE: RobotModel = "p3dx-sh"
# Seconds without a frame, or three frame intervals if longer, until time counts as paused.
_IDLE_S = 0.3


class SimulatedRobots:
    """Fulfils ``observer.robots.contract.RobotWorld``; nothing changes before ``serve``.

    Args:
        world: the one that ``source`` shows, without a held board, since cameras that are shown a
            board must stand still.
        clock: the firmware's, monotonic seconds.

    Attributes:
        world: name of the world, unique each time it is opened.
        vehicles, servings: by role, once they are served.
    """

    def __init__(
        self,
        world: World,
        source: SimulatedSource,
        *,
        clock: Callable[[], float] = clocks.monotonic,
    ) -> None:
        self._world = world
        self._source = source
        self._clock = clock
        self.world = f"{world.spec}:{uuid.uuid4().hex[:12]}"
        self._lock = threading.RLock()
        self.vehicles: dict[Role, DrivenVehicle] = {}
        self.servings: dict[Role, Serving[Firmware]] = {}
        self._ports: tuple[RobotPort, ...] | None = None
        self._closed = False
        self._time: float | None = None
        room = world.scenario.room
        self._room = (*room.x, *room.y)
        self._boxes = tuple(
            _outline(body, 0.0)
            for body in world.bodies
            if body.role == "scenery" and body.bottom == 0.0
        )

    def serve(self) -> tuple[RobotPort, ...]:
        """Serve each robot's firmware on a free TCP port of loopback.

        Call it from the thread that reads the source, or before that thread starts reading.

        Raises:
            InputError: there is no free port.
        """
        if self._ports is None:
            bodies: list[tuple[Role, RobotModel, Body]] = [
                ("observer", _OBSERVER, self._world.observer)
            ]
            robots = [body for body in self._world.obstacles if body.person is None]
            if robots:
                bodies.append(("obstacle", _OBSTACLE, robots[0]))
            self._ports = tuple(self._served(*each) for each in bodies)
            self._world.move({body.id: self.vehicles[role].motion for role, _, body in bodies})
            self._source.follow(self)
        return self._ports

    def close(self) -> None:
        """End serving and cut the robots' power; safe to call twice."""
        self._closed = True
        for serving in self.servings.values():
            serving.close()
        with self._lock:
            for vehicle in self.vehicles.values():
                vehicle.switch_off()

    def _served(self, role: Role, model: RobotModel, body: Body) -> RobotPort:
        bumpers = bumpers_of(model)
        spec = robot_spec(model)
        vehicle = DrivenVehicle(
            spec,
            (body.size[0], body.size[1]),
            body.motion,
            self._lock,
            bumpers=bumpers,
            seed=10 * self._world.seed + body.id,
            idle_s=max(_IDLE_S, 3 / self._world.scenario.frame_rate),
            clock=self._clock,
        )
        vehicle.around = lambda: self._around(vehicle)
        self.vehicles[role] = vehicle
        firmware = Firmware(
            spec, vehicle, now=self._clock(), name=f"simulated {body.name}", bumpers=bumpers
        )
        serving = serve_tcp(firmware, clock=self._clock)
        self.servings[role] = serving
        return RobotPort(role, serving.port, model, body.name)

    # ------------------------------------------------------------------ as DrivenVehicles

    @property
    def goes_on(self) -> bool:
        """True while one of the robots is driven."""
        return not self._closed and any(each.driven for each in self.vehicles.values())

    def advance(self, time: float) -> None:
        """Step from the last frame's time to this one's, in steps of at most 10 ms."""
        with self._lock:
            begin = time if self._time is None else self._time
            vehicles = self.vehicles.values()
            for vehicle in vehicles:
                vehicle.prepare(begin)
            driven = any(vehicle.driven for vehicle in vehicles)
            steps = max(1, math.ceil((time - begin) / STEP_S - 1e-9)) if driven else 1
            for k in range(1, steps + 1):
                self._time = begin + (time - begin) * k / steps
                for vehicle in vehicles:
                    around = self._around(vehicle) if vehicle.motion.started else None
                    vehicle.advance(self._time, around)

    def restart(self) -> None:
        """Put the robots back to their start, motors off."""
        with self._lock:
            for vehicle in self.vehicles.values():
                vehicle.restart()
            self._time = None
            self._world.beginnings += 1
        for serving in self.servings.values():
            serving.robot.motors_off()

    def _around(self, vehicle: DrivenVehicle) -> Surroundings:
        """Return the current surroundings of one robot; the lock is held."""
        time = self._time or 0.0
        mine = {each.motion for each in self.vehicles.values()}
        others = [each.outline for each in self.vehicles.values() if each is not vehicle]
        others += [
            _outline(body, time) for body in self._world.obstacles if body.motion not in mine
        ]
        return Surroundings(self._room, (*self._boxes, *others))


def _outline(body: Body, time: float) -> Outline:
    return outline_at(body.motion.state(time), *body.size[:2])
