"""Judging tracks as the tracker does, frame by frame."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.lifecycle import judge
from observer.methods.rigid.dense.grey_change import Light
from observer.parameters import Parameters
from observer.types import TrackState

from ..solid_worlds import DT

P = Parameters().obstacles
MakeTrack = Callable[..., BodyTrack]
STOOD = (0.0, 0.0, 0.0)
STEADY = Light()


def judge_frames(track: BodyTrack, frames: int = 1, *, light: Light = STEADY) -> TrackState:
    for _ in range(frames):
        judge(track, np.zeros(3), DT, P, light=light)
    return track.state
