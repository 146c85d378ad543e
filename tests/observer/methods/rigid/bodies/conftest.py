"""Fixtures: tracks seen as outlines, and bodies of known points."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.dense.free_space import ARRIVED

from ..solid_worlds import Solid, outline_of
from .judging import MakeTrack
from .planted_bodies import SIZE


@pytest.fixture
def outlined_track(make_track: MakeTrack) -> Callable[..., BodyTrack]:
    """Gives a tentative track with an outline, after frames of either kind of evidence."""

    def make(
        velocity: tuple[float, float, float] = (0.5, 0.0, 0.0),
        *,
        arrived: int = 0,
        uncovered: int = 0,
        sigma: float = 0.03,
        evidence: int = ARRIVED,
        height: float = 1.2,
    ) -> BodyTrack:
        track = make_track((0.0, 0.0, 4.0), velocity, sigma=sigma)
        track.outline = outline_of(Solid((0.0, 0.0, 4.0), (0.45, height, 0.1)), evidence)
        track.outline.arrived_frames, track.outline.uncovered_frames = arrived, uncovered
        return track

    return make


@pytest.fixture
def box(planted: Any, points_on_a_box: Any) -> Any:
    """Gives a box-shaped body of 60 points on a prescribed path."""

    def make(pose: Any, seed: int = 0, per_face: int = 15, **kinds: Any) -> Any:
        rng = np.random.default_rng(seed)
        local, normals = points_on_a_box(rng, kinds.pop("size", SIZE), per_face)
        return planted(local, pose, normals, **kinds)

    return make


@pytest.fixture
def crate(box: Any) -> Any:
    """A body that stands still."""
    return box(lambda _: ((0.9, 0.0, 3.5), 0.4), seed=9)
