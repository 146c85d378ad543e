"""The guard in a closed loop with the cameras: rendered pairs, observed as in the engine."""

from __future__ import annotations

import random
import threading
from dataclasses import replace

import pytest

from observer.camera import as_gray
from observer.guard.free_path import FreePath
from observer.guard.parameters import GuardParameters
from observer.guard.seeing import sight_of_observation
from observer.guard.sight import Sight
from observer.observer import Observer
from observer.parameters import Parameters
from observer.simulation.motion import PlanarMotion, PlanarState
from observer.simulation.robots.driven import Driven
from observer.simulation.robots.floor import Outline, Surroundings
from observer.simulation.scenarios import load_scenario
from observer.simulation.source import SimulatedSource
from observer.simulation.world import Body, World
from observer.trace import FullTrace

from .closed_loop import AMIGO, SEEDS, TICK_S, Lab, drive, steady

SPEEDS = (0.5, 0.4)
# Seconds: where the lab's clock begins.
BEGIN_S = 10.0


class Later:
    """A script that starts from some moment of it."""

    def __init__(self, script: PlanarMotion, since_s: float) -> None:
        self._script, self._since_s = script, since_s

    def state(self, time: float) -> PlanarState:
        return self._script.state(time + self._since_s)

    def commanded_speed(self, time: float) -> float:
        return self._script.commanded_speed(time + self._since_s)


class SimulatedLab(Lab):
    """``simulated:drive`` with a driven observer that sees nothing but its images."""

    def __init__(self, world: World, x: float, y: float, since_s: float) -> None:
        super().__init__(x=x, y=y)
        self._driven = Driven(world.observer.motion, threading.RLock())
        self._driven.begin(-1e-3, self.state())
        crosser = world.obstacles[0]
        world.move({world.observer.id: self._driven, crosser.id: Later(crosser.motion, since_s)})
        self._world, self._crosser = world, world.obstacles[0]
        room = world.scenario.room
        self._room = (*room.x, *room.y)
        self.boxes = tuple(_outline(body, 0.0) for body in world.bodies if body.role == "scenery")
        self._source = SimulatedSource(world)
        self._mount = self._source.info.mount
        p = Parameters()
        self._observer = Observer(self._source.calibration, p, mount=self._mount)
        self._free_path = FreePath(self._observer.camera, self._mount, GuardParameters())

    def around(self, time: float) -> Surroundings:
        moving = _outline(self._crosser, time - BEGIN_S)
        return Surroundings(self._room, (*self.boxes, moving))

    def move(self, command: tuple[float, float], time: float, size: tuple[float, float]) -> None:
        super().move(command, time, size)
        self._driven.add(time - BEGIN_S + TICK_S, self.state(), 0.0)

    def sight(self, index: int, time: float, rng: random.Random) -> Sight:
        """Return the sight of the next frame, which was exposed within the last tick."""
        del index, rng
        frame = self._source.read()
        assert frame is not None
        trace = FullTrace()
        observation = self._observer.observe(frame, trace)
        scan = self._free_path.scan(as_gray(trace["left"]), as_gray(trace["right"]))
        return sight_of_observation(
            replace(observation, received=time), self._observer.camera, self._mount, "w", scan, time
        )


def _outline(body: Body, time: float) -> Outline:
    state = body.motion.state(time)
    return Outline.of_box(state.x, state.y, state.heading, *body.size[:2])


def crossing(seed: int) -> tuple[SimulatedLab, float, float]:
    """Return a lab in which the P3-DX crosses the lane when the robot would be there, the robot's
    speed, and a time by which they have met."""
    rng = random.Random(seed)
    speed = SPEEDS[seed % len(SPEEDS)]
    world = World(load_scenario("drive"), seed % 9)
    script, lane = world.obstacles[0].motion, rng.uniform(-0.3, 0.3)
    crosses = next(k / 20 for k in range(400) if script.state(k / 20).y <= lane)
    # Both arrive by then; the robot starts with a ramp at 0.3 s.
    meets = min(crosses, 5.0)
    distance = speed * (meets - 0.3 - speed / 0.6 - 0.1)
    x = script.state(crosses).x - distance - 0.165 + rng.uniform(-0.15, 0.15)
    return SimulatedLab(world, x, lane, crosses - meets), speed, meets + 1.5


def heedless(lab: Lab, speed: float, seconds: float) -> Lab:
    """Drive at this speed regardless of obstacles."""
    for k in range(round(seconds / TICK_S)):
        velocity = (speed, 0.0) if k * TICK_S > 0.3 else (0.0, 0.0)
        lab.move(velocity, BEGIN_S + k * TICK_S, (AMIGO.length_m, AMIGO.width_m))
    return lab


@pytest.mark.parametrize("seed", range(SEEDS or 1))
def test_a_body_crossing_in_view_is_seen_and_not_hit(seed: int) -> None:
    touched = heedless(*crossing(seed)).touched_mps
    assert max(touched, default=0.0) > 0.1
    lab, speed, seconds = crossing(seed)
    drive(lab, steady(speed), seconds, seed)
    fastest = max(lab.touched_mps, default=0.0)
    print(f"at {speed} m/s: {lab.driven_m:.2f} m, fastest contact {fastest:.3f} m/s")  # noqa: T201
    assert fastest < 0.05
    assert lab.driven_m > 0.1
    # Reasons that only images can give: moving objects and surfaces.
    by_sight = ("obstacle", "an object that", "an obstruction")
    assert any(why.startswith(by_sight) for why in lab.reasons)
