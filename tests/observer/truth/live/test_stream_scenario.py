"""The scenario's bodies as a separate motion-capture system would see them."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from observer.geometry import Pose
from observer.simulation.scenarios import load_scenario
from observer.simulation.truth import SimulatedTruth
from observer.simulation.world import World

from .test_vrpn_client import capturing, samples


def test_program_streams_the_true_bodies_on_its_own_clock(repository: Path) -> None:
    command = [sys.executable, "-m", "tests.observer.truth.live.stream_scenario", "vrpn"]
    with subprocess.Popen(
        [*command, "--drift", "100", "--offset", "1e6"],
        cwd=repository,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            assert process.stdout is not None
            planted = json.loads(process.stdout.readline())
            with capturing(planted["port"]) as capture:
                collected = samples(capture, 100)
                fit = capture.report().clock
        finally:
            process.communicate("quit\n", timeout=5)
    assert process.returncode == 0
    truth = SimulatedTruth(World(load_scenario("lab")))
    T_mocap_world = Pose.from_matrix(planted["T_mocap_world"])
    assert {each.name for each in collected} == set(planted["bodies"])
    errors = []
    for each in collected[::7]:
        # The planted clock, inverted.
        at = (each.time - planted["offset_s"] - planted["start"]) / (1 + 100e-6)
        (body,) = [found for found in truth.bodies(at) if found.name == each.name]
        assert each.position is not None
        errors.append(each.position - T_mocap_world.apply(body.position))
    # Noise of 0.1 mm on each axis.
    assert float(np.abs(errors).max()) < 1e-3
    assert float(np.std(errors)) == pytest.approx(1e-4, rel=0.5)
    assert fit is None or fit.offset_s == pytest.approx(-planted["offset_s"], abs=0.5)
