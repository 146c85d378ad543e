"""Recording of an observed frame: its line, and the ground truth at it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from observer.recording.writer import RecordingWriter
from observer.truth.contract import Truth
from observer.truth.matching import TrueBodyEntry, TruthMatcher
from observer.types import Observation, StereoFrame


class ObservedWriter:
    """Writer of observations with the ground truth at their frames.

    Args:
        truth: on the frames' clock; None without ground truth.
    """

    def __init__(self, writer: RecordingWriter, truth: Truth | None) -> None:
        self._writer = writer
        self._truth = None if truth is None else TruthMatcher(truth)

    def write(
        self, frame: StereoFrame, observation: Observation, line: Mapping[str, Any]
    ) -> list[TrueBodyEntry]:
        """Write the observation of a recorded frame, and return the ground truth at it.

        Args:
            line: of the observation.
        """
        bodies: list[TrueBodyEntry] = []
        if self._truth is not None:
            sample = self._truth.sample(frame.index, frame.time, frame.time)
            self._writer.truth(sample, frame.received)
            bodies = self._truth.match(observation, frame.time)
        self._writer.observation(line, frame.received, truth=bodies)
        return bodies
