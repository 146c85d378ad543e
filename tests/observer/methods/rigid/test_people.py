"""People on simulated scenes: from how far they are seen, against the truth."""

from __future__ import annotations

import numpy as np
import pytest

from observer.observer import Observer
from observer.parameters import Parameters
from observer.types import TrackState

from ...conftest import OpenClip

SAME_M = 0.5
FRAMES = 45


@pytest.mark.parametrize("seed", [1, 4])
def test_a_short_baseline_sees_who_comes_closer_from_far_away(
    seed: int, clip: OpenClip, rigid: Parameters
) -> None:
    """Four cells of disparity, from which on depth is precise, are only 3.4 m away there."""
    here = clip(f"simulated:people_short_baseline?seed={seed}", FRAMES)
    assert here.truth is not None
    observer = Observer(here.calibration, rigid)
    seen_from = []
    for frame in here.frames:
        obstacles = observer.observe(frame).obstacles or ()
        (person,) = [b for b in here.truth.bodies(frame.time) if b.role != "observer"]
        reported = [o.position for o in obstacles if o.state is TrackState.CONFIRMED]
        if any(np.linalg.norm(place - person.position) < SAME_M for place in reported):
            seen_from.append(person.position[2])
    assert len(seen_from) > 15
    assert max(seen_from) > 4.5
