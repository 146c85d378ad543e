"""Exposure that flickers by 40 % twice a second while the camera moves through a still room.

Rendered pictures go straight to the observer: server and robots would only add load. The light's
gain is applied to pictures that are rendered once and played back and forth, so that minutes of
video cost no more than observing them. 20 s of video times ``FAULT_TRIALS`` are observed.
"""

from __future__ import annotations

import functools
import math
from collections import Counter
from dataclasses import dataclass

import numpy as np
import pytest

from observer.observer import Observer
from observer.parameters import Parameters
from observer.simulation.imaging import StereoImager
from observer.simulation.scenarios import load_scenario
from observer.simulation.world import World
from observer.types import Image, Status, StereoFrame

from .bench import TRIALS, tell
from .results import keep

RATE_HZ, SECONDS = 15.0, 20.0 * TRIALS
AMPLITUDE, FLICKER_HZ = 0.4, 2.0
MOST_PER_MIN = 0.1
# Four seconds of rendered pictures.
_PICTURES = 60

pytestmark = [pytest.mark.slow, pytest.mark.timeout(120 + 120 * TRIALS)]


@dataclass(frozen=True)
class Watched:
    """What was observed: frames by status, frames whose reasons mention the light, and tracks
    reported though nothing moves."""

    statuses: Counter[Status]
    told: int
    false_tracks: int

    @property
    def per_min(self) -> float:
        return 60.0 * self.false_tracks / SECONDS


@functools.cache
def watched(scene: str, amplitude: float) -> Watched:
    """Observe a scenario without its robots under flickering light."""
    scenario = load_scenario(scene)
    world = World(scenario.model_copy(update={"robots": ()}))
    imager = StereoImager(world)
    pairs = [imager.pair(k, k / RATE_HZ) for k in range(_PICTURES)]
    observer = Observer(world.true_calibration, Parameters())
    statuses: Counter[Status] = Counter()
    told, tracks = 0, set()
    for k in range(int(SECONDS * RATE_HZ)):
        time = k / RATE_HZ
        gain = 1 + amplitude * math.sin(math.tau * FLICKER_HZ * time)
        place = k % (2 * _PICTURES - 2)
        left, right = (_lit(image, gain) for image in pairs[min(place, 2 * _PICTURES - 2 - place)])
        observation = observer.observe(StereoFrame(k, time, left, right, received=time))
        statuses[observation.status] += 1
        told += any("bright" in reason or "exposure" in reason for reason in observation.reasons)
        tracks |= {(observation.segment, each.id) for each in observation.reported}
    return Watched(statuses, told, len(tracks))


def _lit(image: Image, gain: float) -> Image:
    return np.clip(np.float32(gain) * image + 0.5, 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    "scene", ["lab", pytest.param("static_turning", marks=pytest.mark.patient)]
)
def test_flickering_exposure_loses_no_frame_and_causes_few_false_tracks(scene: str) -> None:
    seen = watched(scene, AMPLITUDE)
    count = seen.statuses.total()
    tell(
        f"fault  5, exposure flickers by {100 * AMPLITUDE:.0f} % at {FLICKER_HZ:g} Hz, {scene}: "
        f"{seen.false_tracks} false tracks in {SECONDS / 60:.1f} min, "
        f"{seen.statuses[Status.LOST]} of {count} frames lost, {seen.told} told of the light"
    )
    keep(5, f"exposure flickers, {scene}", frames=count, false_tracks_per_min=seen.per_min)
    assert count == int(SECONDS * RATE_HZ)
    assert seen.statuses[Status.LOST] == 0
    assert seen.per_min <= MOST_PER_MIN


def test_flickering_exposure_is_reported() -> None:
    seen = watched("lab", AMPLITUDE)
    assert seen.told > 0.5 * seen.statuses.total()
    assert seen.statuses[Status.OK] < 0.5 * seen.statuses.total()
