"""Perception of a robot in a crowd from rendered images, observed like those of a camera.

The crowd's people walk through the simulated lab in clothes and with swinging arms and legs, seen
by two cameras on the robot; the observer and the search for free floor are the real ones. It is so
much slower than the modelled perception (``perceived``) that it is only used for samples.

People must ignore the robot, because their whole walk must be known in advance to animate them.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from observer.camera import as_gray
from observer.evaluation.navigation.crowd import People, Room
from observer.evaluation.navigation.perceived import FRAME_S, WORLD
from observer.geometry import Float64Array
from observer.guard.free_path import FreePath
from observer.guard.parameters import GuardParameters
from observer.guard.seeing import sight_of_observation
from observer.guard.sight import Sight
from observer.observer import Observer
from observer.parameters import Parameters
from observer.simulation.motion import Parked, PlanarState
from observer.simulation.robots.driven import Driven
from observer.simulation.scenarios import scenario_from_text
from observer.simulation.source import SimulatedSource
from observer.simulation.specs.people import PersonSpec
from observer.simulation.world import World
from observer.types import StereoFrame

# Time constant of a body's turn towards its direction of motion, and speed below which it does not
# turn.
_TURNING_S: Final = 0.3
_STATIONARY_MPS: Final = 0.2


@dataclass(frozen=True, eq=False)
class Walked:
    """Path of one person from a crowd model; fulfils ``PlanarMotion``.

    Attributes:
        states: (T, 5) x, y, heading, vx, vy at multiples of ``FRAME_S``.
    """

    states: Float64Array

    def state(self, time: float) -> PlanarState:
        """Interpolate the state; before and after, the person stands at the first or last place."""
        at = time / FRAME_S
        if not 0 <= at <= len(self.states) - 1:
            x, y, heading, *_ = self.states[0 if at < 0 else -1].tolist()
            return PlanarState(x, y, heading)
        k = min(int(at), len(self.states) - 2)
        share = at - k
        x, y, heading, vx, vy = ((1 - share) * self.states[k] + share * self.states[k + 1]).tolist()
        return PlanarState(x, y, heading, vx, vy)

    def commanded_speed(self, time: float) -> float:
        """Return the actual speed, as none is commanded."""
        state = self.state(time)
        return math.hypot(state.vx, state.vy)


def walks_of(steps: Sequence[People], origin: tuple[float, float]) -> list[Walked]:
    """Return everybody's path.

    Args:
        steps: everybody at multiples of ``FRAME_S``. origin: of the paths' frame, metres.
    """
    place = np.array([each.position for each in steps]) - origin
    velocity = np.array([each.velocity for each in steps])
    walks = []
    for k in range(place.shape[1]):
        headings = _headings(velocity[:, k])
        walks.append(Walked(np.column_stack([place[:, k], headings, velocity[:, k]])))
    return walks


def _headings(velocity: Float64Array) -> Float64Array:
    """(T,) continuous headings of a body that moves with velocities (T, 2)."""
    moving = np.hypot(*velocity.T) > _STATIONARY_MPS
    ways = np.arctan2(velocity[:, 1], velocity[:, 0])
    heading = float(ways[np.argmax(moving)])
    share = 1 - math.exp(-FRAME_S / _TURNING_S)
    headings = []
    for way, moves in zip(ways.tolist(), moving.tolist(), strict=True):
        if moves:
            heading += share * math.remainder(way - heading, 2 * math.pi)
        headings.append(heading)
    return np.array(headings)


class RenderedPerception:
    """Perception of one robot from images of a crowd, given the whole motion of the crowd."""

    def __init__(
        self, steps: Sequence[People], start: tuple[float, float], seed: int, p: GuardParameters
    ) -> None:
        """
        Args:
            steps: everybody at multiples of ``FRAME_S``, in the room's frame. start: where the
                robot starts, facing along x. p: of the search for free floor.
        """
        self._start = np.array([*start, 0.0])
        walks = walks_of(steps, start)
        first = [walk.state(0.0) for walk in walks]
        people = tuple(PersonSpec(x=one.x, y=one.y) for one in first)
        scenario = scenario_from_text("based_on: _crowd", "crowd")
        # Not seed 0, which would dress everybody exactly as specified.
        world = World(scenario.model_copy(update={"people": people}), seed + 1, walks=walks)
        self._driven = Driven(Parked(0.0, 0.0, 0.0), threading.RLock())
        world.move({world.observer.id: self._driven})
        self._source = SimulatedSource(world)
        calibration, mount = world.calibration, self._source.info.mount
        assert mount is not None
        parameters = Parameters()
        self._observer = Observer(calibration, parameters, mount=mount)
        self._mount = mount
        camera = self._observer.camera
        self._free_path = FreePath(camera, mount, p)
        self._last = PlanarState(0.0, 0.0, 0.0)

    def look(self, people: People, pose: Float64Array, room: Room, time: float) -> Sight:
        """Return the sight from a pose (3,), of a frame received at ``time``.

        People are at their places on the known paths.
        """
        del people, room
        self._drive_to(pose - self._start, time)
        frame = self._source.read()
        # The scenario lasts longer than any run.
        assert isinstance(frame, StereoFrame)
        frame = replace(frame, received=time)
        observation = self._observer.observe(frame)
        assert frame.right is not None
        scan = self._free_path.scan(as_gray(frame.left), as_gray(frame.right))
        return sight_of_observation(
            observation, self._observer.camera, self._mount, WORLD, scan, time
        )

    def _drive_to(self, place: Float64Array, time: float) -> None:
        x, y, heading = place.tolist()
        last = self._last
        rates = np.array([x - last.x, y - last.y, heading - last.heading]) / FRAME_S
        state = PlanarState(x, y, heading, *rates.tolist())
        if self._driven.started:
            self._driven.add(time, state, float(np.hypot(rates[0], rates[1])))
        else:
            self._driven.begin(time, state)
        self._last = state
