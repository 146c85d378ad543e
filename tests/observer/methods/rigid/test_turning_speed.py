"""Speeds of a robot on the lab's half circles, against the truth."""

from __future__ import annotations

import numpy as np
import pytest

from observer.observer import Observer
from observer.parameters import Parameters
from observer.simulation.scenarios import load_scenario
from observer.simulation.source import SimulatedSource
from observer.simulation.truth import SimulatedTruth
from observer.simulation.world import World
from observer.types import TrackState

# rad/s: yaw rate above which the robot counts as turning.
TURNS = 0.5
# The simulated robot starts to turn from one frame to the next; time allowed to notice that.
NOTICED_S = 0.3
SAME_M = 0.5
VISIBLE = 0.5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "rmse_mps"),
    [
        (0, 0.02),
        pytest.param(1, 0.02, marks=pytest.mark.patient),
        # It goes out of sight in one of the turns and is found again by its edge.
        pytest.param(2, 0.045, marks=pytest.mark.patient),
        pytest.param(3, 0.025, marks=pytest.mark.patient),
    ],
)
def test_speed_is_accurate_while_a_robot_turns(seed: int, rmse_mps: float) -> None:
    world = World(load_scenario("lab"), seed)
    source, truth = SimulatedSource(world), SimulatedTruth(world)
    observer = Observer(source.calibration, Parameters(), mount=source.info.mount)
    errors, bands = [], []
    yaw, turned_s, before = 0.0, 0.0, 0.0
    for _ in range(300):
        frame = source.read()
        assert frame is not None
        seen = observer.observe(frame).obstacles or ()
        (body,) = [b for b in truth.bodies(frame.time) if b.role == "obstacle"]
        change = (body.yaw - yaw + np.pi) % (2 * np.pi) - np.pi
        turns = abs(change) > TURNS * (frame.time - before)
        turned_s = turned_s + frame.time - before if turns else 0.0
        yaw, before = body.yaw, frame.time
        if turned_s < NOTICED_S or body.visible is None or body.visible < VISIBLE:
            continue
        for obstacle in seen:
            near = np.linalg.norm(obstacle.position - body.position) < SAME_M
            if obstacle.state is TrackState.CONFIRMED and near:
                errors.append(abs(obstacle.speed - float(np.linalg.norm(body.velocity))))
                bands.append(1.96 * obstacle.speed_std)
    assert len(errors) > 80
    assert np.sqrt(np.mean(np.square(errors))) <= rmse_mps
    assert np.quantile(errors, 0.95) <= 2.5 * rmse_mps
    assert np.mean(np.less_equal(errors, bands)) >= 0.9
