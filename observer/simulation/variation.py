"""Builds motions from a scenario, and varies a scenario by a seed."""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np

from observer.errors import ScenarioError
from observer.simulation.held_board import drawn_anew
from observer.simulation.motion import Course, Leg, Oscillation, Parked, PlanarMotion, Sway
from observer.simulation.rig import true_calibration
from observer.simulation.scenarios import Scenario
from observer.simulation.specs.base import SineSpec, Spec
from observer.simulation.specs.boards import BoardSpec
from observer.simulation.specs.people import PersonSpec
from observer.simulation.specs.places import HangingSpec, ObjectSpec, PosterSpec, StandingSpec
from observer.simulation.specs.vehicles import (
    ArcLeg,
    DriveLeg,
    LegSpec,
    RobotSpec,
    SwaySpec,
    TurnLeg,
    VehicleSpec,
    WaypointsSpec,
)

_S = TypeVar("_S", bound=Spec)


def build_motion(spec: VehicleSpec | StandingSpec) -> PlanarMotion:
    """Build the motion of a vehicle or of a standing object.

    Raises:
        ScenarioError: a leg is too short for its speed, or waypoints coincide.
    """
    heading = math.radians(spec.heading_deg)
    motion = None if isinstance(spec, StandingSpec) else spec.motion
    if motion is None:
        return Parked(spec.x, spec.y, heading)
    if isinstance(motion, SwaySpec):
        return Sway(
            spec.x,
            spec.y,
            heading,
            oscillation(motion.forward),
            oscillation(motion.left),
            oscillation(motion.turn, math.pi / 180),
        )
    if isinstance(motion, WaypointsSpec):
        legs = _legs_between(spec.x, spec.y, heading, motion)
    else:
        legs = [_leg(leg) for leg in motion.legs]
    return Course(
        spec.x,
        spec.y,
        heading,
        legs,
        after=motion.after,
        acceleration=motion.acceleration,
        angular_acceleration=math.radians(motion.angular_acceleration_deg),
    )


def oscillation(spec: SineSpec, unit: float = 1.0) -> Oscillation:
    """Build an oscillation; ``unit`` converts the amplitude."""
    return Oscillation(spec.amplitude * unit, spec.period_s, math.radians(spec.phase_deg))


def _leg(spec: LegSpec) -> Leg:
    if isinstance(spec, DriveLeg):
        return Leg(distance=spec.distance_m, speed=spec.speed)
    if isinstance(spec, ArcLeg):
        angle = math.radians(spec.angle_deg)
        return Leg(distance=abs(angle) * spec.radius_m, angle=angle, speed=spec.speed)
    if isinstance(spec, TurnLeg):
        return Leg(angle=math.radians(spec.angle_deg), rate=math.radians(spec.rate_deg))
    return Leg(seconds=spec.seconds)


def _legs_between(x: float, y: float, heading: float, spec: WaypointsSpec) -> list[Leg]:
    """Build turns on the spot and straight legs; a repeated tour returns to its start pose."""
    points = list(spec.points)
    if spec.after == "repeat":
        points.append((x, y))
    first_heading = heading
    rate = math.radians(spec.turn_rate_deg)
    legs: list[Leg] = []
    for px, py in points:
        distance = math.hypot(px - x, py - y)
        if distance < 1e-9:
            raise ScenarioError(
                f"the waypoint ({px:g}, {py:g}) equals the vehicle's current position"
            )
        turn = math.remainder(math.atan2(py - y, px - x) - heading, 2 * math.pi)
        if abs(turn) > 1e-9:
            legs.append(Leg(angle=turn, rate=rate))
        legs.append(Leg(distance=distance, speed=spec.speed))
        x, y, heading = px, py, heading + turn
    back = math.remainder(first_heading - heading, 2 * math.pi)
    if spec.after == "repeat" and abs(back) > 1e-9:
        legs.append(Leg(angle=back, rate=rate))
    return legs


def varied(scenario: Scenario, seed: int) -> Scenario:
    """Return the scenario varied by ``seed``; seed 0 leaves it as written."""
    if seed == 0:
        return scenario
    bounds = scenario.variation
    rng = np.random.default_rng(np.random.SeedSequence([seed, 0x5EED]))

    def draw(bound: float) -> float:
        return float(rng.uniform(-bound, bound))

    def moved(spec: VehicleSpec | StandingSpec) -> dict[str, float]:
        return {
            "x": spec.x + draw(bounds.position_m),
            "y": spec.y + draw(bounds.position_m),
            "heading_deg": spec.heading_deg + draw(bounds.heading_deg),
        }

    robots: list[RobotSpec] = []
    for robot in scenario.robots:
        driven = _faster(robot, 1 + draw(bounds.speed))
        robots.append(driven.model_copy(update=moved(robot)))
    # The observer keeps its position, the room frame's origin; only its motion varies.
    observer = _faster(scenario.observer, 1 + draw(bounds.speed))
    designs = [item.design for item in scenario.objects if isinstance(item, PosterSpec)]
    rng.shuffle(designs)
    objects: list[ObjectSpec] = []
    below = (0.0, 0.0)
    for item in scenario.objects:
        if isinstance(item, HangingSpec):
            hung: dict[str, object] = {"along_m": item.along_m + draw(bounds.position_m)}
            if isinstance(item, PosterSpec):
                hung["design"] = designs.pop()
            objects.append(item.model_copy(update=hung))
        elif item.above_m:
            # What stands on a box moves with it.
            x, y = item.x + below[0], item.y + below[1]
            objects.append(item.model_copy(update={"x": x, "y": y}))
        else:
            change = moved(item)
            below = (change["x"] - item.x, change["y"] - item.y)
            objects.append(item.model_copy(update=change))
    board: BoardSpec | None = None
    if scenario.board is not None:
        calibration = true_calibration(scenario.camera, scenario.faults)
        board = drawn_anew(
            scenario.board, calibration, bounds.board_shift, bounds.board_turn_deg, rng
        )
    people: list[PersonSpec] = []
    for person in scenario.people:
        walking = _faster(person, 1 + draw(bounds.speed))
        build = {
            "height_m": person.height_m + draw(bounds.stature_m),
            "build": person.build * (1 + draw(bounds.build)),
        }
        people.append(walking.model_copy(update={**moved(person), **build}))
    things = {"robots": tuple(robots), "objects": tuple(objects), "people": tuple(people)}
    return scenario.model_copy(update={**things, "observer": observer, "board": board})


def _faster(spec: _S, factor: float) -> _S:
    """Return the same path at ``factor`` times the speed."""
    change: dict[str, object] = {}
    for name, value in spec:
        if name in ("speed", "rate_deg", "turn_rate_deg"):
            change[name] = value * factor
        elif name in ("acceleration", "angular_acceleration_deg"):
            change[name] = value * factor**2
        elif name == "period_s":
            change[name] = value / factor
        elif name == "legs":
            change[name] = tuple(_faster(leg, factor) for leg in value)
        elif isinstance(value, Spec):
            change[name] = _faster(value, factor)
    return spec.model_copy(update=change)
