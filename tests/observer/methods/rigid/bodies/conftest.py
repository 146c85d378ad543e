"""Tracks that are seen as outlines."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.dense.free_space import ARRIVED

from ..solid_worlds import Solid, outline_of
from .judging import MakeTrack


@pytest.fixture
def guest(make_track: MakeTrack) -> Callable[..., BodyTrack]:
    """Gives a tentative track with an outline: after frames of either kind of evidence."""

    def make(
        velocity: tuple[float, float, float] = (0.5, 0.0, 0.0),
        *,
        arrived: int = 0,
        hidden: int = 0,
        sigma: float = 0.03,
        evidence: int = ARRIVED,
        height: float = 1.2,
    ) -> BodyTrack:
        track = make_track((0.0, 0.0, 4.0), velocity, sigma=sigma)
        track.outline = outline_of(Solid((0.0, 0.0, 4.0), (0.45, height, 0.1)), evidence)
        track.outline.arrived_frames, track.outline.hidden_frames = arrived, hidden
        return track

    return make
