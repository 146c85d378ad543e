"""Alignment during a run, solved every two seconds over the last three minutes."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from observer.errors import TruthError
from observer.geometry import Float64Array
from observer.truth.alignment.alignment import align
from observer.truth.alignment.choices import AlignmentChoices
from observer.truth.alignment.observed import ObservedRun
from observer.truth.alignment.result import Alignment
from observer.truth.motion_capture import (
    BodySample,
    Capture,
    Trajectory,
    rising_samples,
    trajectory_of,
)

WINDOW_S = 180.0
# Seconds of the source's clock between two solutions.
SOLVE_EVERY_S = 2.0
# Three minutes of a source at 60 frames per second.
_MOST_LINES = 60 * 180
_NONE_YET = "not aligned yet: no data from both sides so far"


class OnlineAlignment:
    """Keeps the latest data and aligns it; it has no thread and reads no clock itself.

    Args:
        choices: as for ``align``; ``search`` should be given if a server's clock is fitted.

    Attributes:
        choices: may be replaced between two solutions.
        state: the alignment, or one sentence that begins with "not aligned yet".
    """

    def __init__(self, choices: AlignmentChoices | None = None) -> None:
        self.choices = choices or AlignmentChoices()
        self._lines: deque[Mapping[str, Any]] = deque(maxlen=_MOST_LINES)
        # By body, in pieces as they arrived, on the server's own clock.
        self._pieces: dict[str, deque[Trajectory]] = {}
        self._solved: float | None = None
        self.state: Alignment | str = _NONE_YET

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies that have samples."""
        return tuple(self._pieces)

    def add_observation(self, line: Mapping[str, Any]) -> None:
        """Add a line as ``observer.jsonl.observation_line`` makes it."""
        if self._lines and float(line["time"]) < float(self._lines[-1]["time"]):
            self.begin_anew()
        self._lines.append(line)
        oldest = float(line["time"]) - WINDOW_S
        while float(self._lines[0]["time"]) < oldest:
            self._lines.popleft()

    def begin_anew(self) -> None:
        """Forget the run: the source changed or restarted, with another clock and world."""
        self._lines.clear()
        self._solved = None
        self.state = _NONE_YET

    def add_pieces(self, pieces: Iterable[Trajectory]) -> None:
        """Add pieces as returned by ``pieces``; samples not later than the last are dropped."""
        for piece in pieces:
            kept = self._pieces.setdefault(piece.name, deque())
            if kept:
                piece = piece.part(piece.times > kept[-1].times[-1])
            if not len(piece.times):
                continue
            kept.append(piece)
            while kept[0].times[-1] < piece.times[-1] - WINDOW_S:
                kept.popleft()

    def solve(self, to_source: Callable[[Float64Array], Float64Array] | None = None) -> bool:
        """Align again if two seconds have passed since the last try; return whether it tried.

        This takes from tenths of a second to seconds, so call it outside the frame loop. If the
        alignment fails, as when the robot stands still for minutes, the last result is kept.

        Args:
            to_source: converts stamps (N,) to the times used for alignment; None keeps the stamps.
        """
        if not self._lines or not self._pieces:
            return False
        now = float(self._lines[-1]["time"])
        if self._solved is not None and now - self._solved < SOLVE_EVERY_S:
            return False
        self._solved = now
        capture = self._capture(to_source)
        try:
            self.state = align(ObservedRun.of_lines(self._lines), capture, self.choices)
        except TruthError as error:
            if not isinstance(self.state, Alignment):
                self.state = f"not aligned yet: {error}"
        return True

    def _capture(self, to_source: Callable[[Float64Array], Float64Array] | None) -> Capture:
        """Return the last minutes of all bodies."""
        bodies = {name: _joined(list(kept)) for name, kept in self._pieces.items()}
        if to_source is not None:
            bodies = {
                name: Trajectory(name, to_source(body.times), body.positions, body.rotations)
                for name, body in bodies.items()
            }
        return Capture("live", None, bodies)


def pieces(samples: Iterable[BodySample]) -> list[Trajectory]:
    """Collect samples into trajectories by body, in order of arrival, on the server's clock."""
    return [trajectory_of(name, kept) for name, kept in rising_samples(samples).items()]


def _joined(parts: list[Trajectory]) -> Trajectory:
    rotations = None
    if any(part.rotations is not None for part in parts):
        rotations = np.concatenate(
            [
                np.full((len(p.times), 3, 3), np.nan) if p.rotations is None else p.rotations
                for p in parts
            ]
        )
    return Trajectory(
        parts[0].name,
        np.concatenate([part.times for part in parts]),
        np.concatenate([part.positions for part in parts]),
        rotations,
    )
