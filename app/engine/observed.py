"""Observed frame in the form needed by everything downstream of the observer."""

from __future__ import annotations

from dataclasses import dataclass

from observer.camera import StereoCamera
from observer.parameters import Parameters
from observer.trace import TraceValues
from observer.types import Observation, StereoFrame


@dataclass(frozen=True, eq=False)
class Observed:
    """Observed frame with everything that led to its result.

    Attributes:
        frame: as it was played.
        observation: the result.
        trace: the observer's intermediate images and numbers by name (see ``observer.observer``).
        camera: the rectified pair.
        parameters: those used for this frame.
        segment: segment number, counted across engine restarts.
    """

    frame: StereoFrame
    observation: Observation
    trace: TraceValues
    camera: StereoCamera
    parameters: Parameters
    segment: int
