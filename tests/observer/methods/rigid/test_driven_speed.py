"""Speeds of a robot driven by figure 17's programmes, against the truth.

The work of the server, its drive process and the robots' firmware runs on the frames' clock here,
so that it is reproducible; ``dynamic-observer reproduce`` measures the whole.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from observer.intervals import SIGMAS_95
from observer.motion_profiles.gesture import GESTURE_S
from observer.motion_profiles.library import load_profile
from observer.motion_profiles.playing import duration_s, velocity_at
from observer.observer import Observer
from observer.parameters import Parameters
from observer.rig.rig import Role
from observer.simulation.robots.chassis import Drive
from observer.simulation.robots.world_robots import SimulatedRobots
from observer.simulation.scenarios import load_scenario
from observer.simulation.source import SimulatedSource
from observer.simulation.truth import SimulatedTruth
from observer.simulation.world import World
from observer.types import StereoFrame, TrackState

# m/s: limit by which the paper's experiments are judged.
RMSE_MPS = 0.03
# Seconds: when the obstacle, crossing until then, is stopped, and when the programme starts.
STOPPED_S, BEGINS_S = 2.6, 4.0
SAME_M = 1.0
# Share of a robot below which it has left the image.
LEAST_VISIBLE = 0.04


def driven(world: World, source: SimulatedSource, until_s: float) -> Iterator[StereoFrame]:
    """Frames of the first experiment: both robots driven by the programme."""
    programme = load_profile("figure17_a")
    robots = SimulatedRobots(world, source)
    robots.serve()
    # Their firmware runs on the wall clock, so it is left out.
    for serving in robots.servings.values():
        serving.close()
    time = 0.0
    while time < until_s:
        roles: tuple[Role, ...] = ("observer", "obstacle") if time >= STOPPED_S else ()
        for role in roles:
            velocity = velocity_at(programme, role, time - BEGINS_S)
            speed = 0.0 if velocity is None else velocity[0]
            robots.vehicles[role].drive(Drive(speed_mps=speed, powered=True))
        frame = source.read()
        assert frame is not None
        yield frame
        time = frame.time + 1 / source.info.frame_rate
    robots.close()


@pytest.mark.parametrize(
    ("seed", "seconds"),
    [
        (1, GESTURE_S),
        *(
            pytest.param(seed, duration_s(load_profile("figure17_a")), marks=pytest.mark.patient)
            for seed in (5, 6)
        ),
    ],
)
def test_speeds_are_accurate_while_a_robot_starts_stops_and_reverses(
    seed: int, seconds: float
) -> None:
    world = World(load_scenario("drive"), seed)
    source, truth = SimulatedSource(world), SimulatedTruth(world)
    observer = Observer(source.calibration, Parameters(), mount=source.info.mount)
    errors, bands, names, visible = [], [], set(), 0
    for frame in driven(world, source, BEGINS_S + seconds):
        seen = observer.observe(frame).obstacles or ()
        if frame.time < BEGINS_S:
            continue
        (robot,) = [b for b in truth.bodies(frame.time) if b.role == "obstacle"]
        if robot.visible < LEAST_VISIBLE:
            # It drives out of the image.
            continue
        visible += 1
        for obstacle in seen:
            (body,) = [b for b in truth.bodies(obstacle.velocity_time) if b.role == "obstacle"]
            near = np.linalg.norm(obstacle.position - body.position) < SAME_M
            if obstacle.state is TrackState.CONFIRMED and near:
                errors.append(obstacle.speed - float(np.linalg.norm(body.velocity)))
                bands.append(SIGMAS_95 * obstacle.speed_std)
                names.add(obstacle.id)
    # It is never lost and keeps its id.
    assert len(names) == 1
    assert len(errors) == visible
    assert visible >= 0.97 * seconds * source.info.frame_rate
    assert np.sqrt(np.mean(np.square(errors))) <= RMSE_MPS
    assert np.abs(errors).max() <= 2 * RMSE_MPS
    assert np.mean(np.abs(errors) <= bands) >= 0.85
