"""People who walk about on a floor, moved by an independent crowd model: JuPedSim.

They walk between random targets, chosen by a mechanism of its own; nothing here is tuned to a
robot's way of planning. The extra ``crowd`` installs JuPedSim (https://www.jupedsim.org).

The operational model is WarpDriver (Wolinski, Lin and Pettré, WarpDriver: context-aware
probabilistic motion prediction for crowd simulation, ACM Transactions on Graphics 35(6), 2016):
all people expect the others to walk on as they do, and turn away from where a collision is
probable within 2 s; JuPedSim, which includes it since 1.4, adds a short-range repulsion. It was
chosen by trials with 0.1 to 0.5 people per m2: it kept people walking everywhere, at a step of
50 ms. With default parameters, the anticipation velocity model came to a standstill at 0.5 per m2,
and the third collision-free speed model even at 0.1; the second slowed everybody down to 0.4 m/s
at 0.5 per m2, where people here walk at 0.7; the social force model threw people out of the room
at a step of 50 ms, and at the 10 ms that it needs it is too slow.

A robot that people avoid is an extra agent in their simulation, never moved by it. JuPedSim cannot
reposition agents, so before each of its steps the robot's agent is removed and added again with
the robot's place, direction, speed and radius. Removal comes before any interaction, and this model
accepts a new agent anywhere in the room, even in contact with a person.
"""

from __future__ import annotations

import importlib
import importlib.util
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer.errors import InputError
from observer.extras import package_missing
from observer.geometry import Float64Array

# Step of the simulation; half and twice as much gave similar figures.
_STEP_S = 0.05
# Free walking speed, somewhat below the 1.34 +- 0.26 m/s of Weidmann, Transporttechnik der
# Fussgänger, ETH Zürich, 1993.
_SPEED_MPS, _SPEED_SIGMA_MPS = 1.2, 0.25
_SLOWEST_MPS, _FASTEST_MPS = 0.5, 1.8
_RADIUS_M = (0.2, 0.25)
# How fast a person starts and stops; by the model alone it would take one step.
_ACCELERATION_MPS2 = 2.5
_STAND_CHANCE = 0.2
_STAND_S = (1.0, 4.0)
_REACHED_M = 0.75
# Least distance of targets from walls if the room is wide enough, as people keep off walls.
_FROM_WALL_M = 0.75
# Factor on the time of the straight way, and seconds more, after which a person gives up a target,
# because somebody may be standing there.
_PATIENCE, _PATIENCE_S = 2.0, 5.0
# Initial gap between bodies, and from bodies to walls.
_GAP_M = 0.1
_ATTEMPTS = 2000
# In narrower rooms the model presses people into the walls.
_LEAST_SIDE_M = 2.0


@dataclass(frozen=True)
class Room:
    """Rectangular floor, metres; the origin is its lower left corner.

    Attributes:
        length_m: along x. width_m: along y.
    """

    length_m: float
    width_m: float

    @property
    def size(self) -> Float64Array:
        """Its upper right corner, (2,)."""
        return np.array([self.length_m, self.width_m])


@dataclass(frozen=True, eq=False)
class People:
    """N people at one instant, in the room's frame.

    Attributes:
        number: (N,), constant per person. position: (N, 2), metres. velocity: (N, 2), m/s, over
            the last 50 ms. radius_m: (N,), of a body.
    """

    number: NDArray[np.intp]
    position: Float64Array
    velocity: Float64Array
    radius_m: Float64Array


class Crowd:
    """People in a room; equal arguments and robot motions give equal people, to the last digit."""

    def __init__(
        self,
        room: Room,
        density_per_m2: float,
        seed: int,
        *,
        kind: bool,
        keep_clear: tuple[float, float, float],
    ) -> None:
        """
        Args:
            kind: True for people who avoid the robot as they avoid a person, False for people who
                ignore it. Both start the same.
            keep_clear: x, y and radius of a circle, metres, that is free of people at the
                beginning: where the robot starts.

        Raises:
            InputError: JuPedSim is not installed, the room is narrower than 2 m, or the people do
                not fit into it.
        """
        missing = crowd_missing()
        if missing is not None:
            raise InputError(missing)
        if not min(room.length_m, room.width_m) >= _LEAST_SIDE_M:
            raise InputError(f"a room with a crowd is at least {_LEAST_SIDE_M:g} m wide and long")
        if not 0 <= density_per_m2 < math.inf:
            raise InputError("a crowd's density is a number of people per m2, not below 0")
        self._room = room
        self._kind = kind
        self._rng = np.random.default_rng(seed)
        count = round(density_per_m2 * room.length_m * room.width_m)
        self._radius = self._rng.uniform(*_RADIUS_M, count)
        speed = self._rng.normal(_SPEED_MPS, _SPEED_SIGMA_MPS, count)
        self._speed = np.clip(speed, _SLOWEST_MPS, _FASTEST_MPS)
        self._position = _scattered(room, self._radius, keep_clear, self._rng)
        self._target = np.array([self._drawn_target() for _ in range(count)]).reshape(-1, 2)
        rest = self._target - self._position
        distance = np.maximum(np.hypot(rest[:, 0], rest[:, 1]), 1e-9)
        self._velocity = rest * (self._speed / distance)[:, None]
        # The speed at which a person would walk now if nobody were in the way.
        self._pace = self._speed.copy()
        # Until when each person stands; 0 for those who walk.
        self._stationary_until = np.zeros(count)
        self._gives_up = _PATIENCE * distance / self._speed + _PATIENCE_S
        self._steps = 0
        self._start_simulation()

    def _start_simulation(self) -> None:
        # Untyped, and installed only with an extra.
        jupedsim: Any = importlib.import_module("jupedsim")

        length, width = self._room.length_m, self._room.width_m
        self._simulation: Any = jupedsim.Simulation(
            model=jupedsim.WarpDriverModel(),
            geometry=[(0.0, 0.0), (length, 0.0), (length, width), (0.0, width)],
            dt=_STEP_S,
        )
        self._stage = self._simulation.add_direct_steering_stage()
        self._journey = self._simulation.add_journey(jupedsim.JourneyDescription([self._stage]))
        self._parameters = jupedsim.WarpDriverModelAgentParameters
        heading = self._velocity / self._speed[:, None]
        self._ids = [
            self._add_agent(*each)
            for each in zip(self._position, heading, self._speed, self._radius, strict=True)
        ]
        self._robot_id: int | None = None
        for i in range(len(self._ids)):
            self._send(i)

    def _add_agent(
        self, position: Float64Array, heading: Float64Array, speed: float, radius: float
    ) -> int:
        added: int = self._simulation.add_agent(
            self._parameters(
                position=(float(position[0]), float(position[1])),
                orientation=(float(heading[0]), float(heading[1])),
                desired_speed=float(speed),
                radius=float(radius),
                journey_id=self._journey,
                stage_id=self._stage,
            )
        )
        return added

    @property
    def people(self) -> People:
        """Current state of all people."""
        return People(
            np.arange(len(self._ids)),
            self._position.copy(),
            self._velocity.copy(),
            self._radius.copy(),
        )

    def step(self, dt: float, robot: tuple[float, float, float, float, float]) -> None:
        """Move everybody on by ``dt`` seconds, a multiple of 50 ms.

        Args:
            robot: x, y, vx, vy and radius of the robot now, metres and m/s in the room's frame;
                it is assumed to keep its velocity during the step. If it is outside the room,
                people see it at the wall.
        """
        count = round(dt / _STEP_S)
        if count < 1 or abs(count * _STEP_S - dt) > 1e-6:
            raise ValueError(f"a crowd's step is a multiple of {_STEP_S} s, not {dt} s")
        x, y, vx, vy, radius = robot
        for k in range(count):
            self._decide()
            if self._kind:
                ahead = k * _STEP_S
                self._place_robot((x + vx * ahead, y + vy * ahead), (vx, vy), radius)
            self._simulation.iterate()
            self._steps += 1
            self._take_positions()

    def _decide(self) -> None:
        """Let people who have arrived stand, and those who have stood long enough walk on."""
        now = self._steps * _STEP_S
        rest = self._target - self._position
        arrived = (np.hypot(rest[:, 0], rest[:, 1]) < _REACHED_M) | (now >= self._gives_up)
        stood = self._stationary_until > 0
        for i in np.flatnonzero(np.where(stood, now >= self._stationary_until, arrived)).tolist():
            if not stood[i]:
                # Nobody turns round while walking: they come to a stop first.
                stays = self._rng.uniform(*_STAND_S) if self._rng.random() < _STAND_CHANCE else 0.0
                self._stationary_until[i] = now + self._pace[i] / _ACCELERATION_MPS2 + stays
            else:
                self._stationary_until[i] = 0.0
                self._target[i] = self._drawn_target()
                distance = math.dist(self._target[i], self._position[i])
                self._gives_up[i] = now + _PATIENCE * distance / self._speed[i] + _PATIENCE_S
                self._send(i)
        wanted = np.where(self._stationary_until > 0, 0.0, self._speed)
        change = np.clip(wanted - self._pace, *(_STEP_S * _ACCELERATION_MPS2 * np.array([-1, 1])))
        self._pace += change
        for i in np.flatnonzero(change).tolist():
            self._simulation.agent(self._ids[i]).model.desired_speed = float(self._pace[i])

    def _drawn_target(self) -> Float64Array:
        margin = np.minimum(_FROM_WALL_M, self._room.size / 3)
        return self._rng.uniform(margin, self._room.size - margin)

    def _send(self, i: int) -> None:
        x, y = self._target[i]
        self._simulation.agent(self._ids[i]).target = (float(x), float(y))

    def _place_robot(
        self, position: tuple[float, float], velocity: tuple[float, float], radius: float
    ) -> None:
        if self._robot_id is not None:
            self._simulation.mark_agent_for_removal(self._robot_id)
        speed = math.hypot(*velocity)
        heading = np.array(velocity) / speed if speed > 0 else np.array([1.0, 0.0])
        inside = np.clip(position, 0.0, self._room.size)
        self._robot_id = self._add_agent(inside, heading, speed, radius)

    def _take_positions(self) -> None:
        places = {agent.id: agent.position for agent in self._simulation.agents()}
        position = np.array([places[each] for each in self._ids]).reshape(-1, 2)
        self._velocity = (position - self._position) / _STEP_S
        self._position = position


def crowd_missing() -> str | None:
    """Return one sentence on how to install a missing package for crowds, or None."""
    if importlib.util.find_spec("jupedsim") is not None:
        return None
    return package_missing("a crowd", "crowd", "jupedsim")


def _scattered(
    room: Room,
    radius: Float64Array,
    keep_clear: tuple[float, float, float],
    rng: np.random.Generator,
) -> Float64Array:
    """Random positions (N, 2) for bodies of these radii (N,), apart from each other."""
    placed = np.empty((len(radius), 2))
    clear_x, clear_y, clear_radius = keep_clear
    for i, own in enumerate(radius):
        margin = own + _GAP_M
        for _ in range(_ATTEMPTS):
            place = rng.uniform(margin, room.size - margin)
            gaps = np.hypot(*(placed[:i] - place).T) - radius[:i] - margin
            in_the_clear = math.dist(place, (clear_x, clear_y)) < clear_radius + own
            if not in_the_clear and not (gaps < 0).any():
                placed[i] = place
                break
        else:
            raise InputError(
                f"{len(radius)} people do not fit into a room of {room.length_m:g} x "
                f"{room.width_m:g} m; take fewer or a larger room"
            )
    return placed
