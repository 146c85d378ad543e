"""The alignment while a run goes on: solved again now and then over the last minutes."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from observer.errors import TruthError
from observer.truth.alignment.aligned import AlignedTruth
from observer.truth.alignment.alignment import align
from observer.truth.alignment.choices import AlignmentChoices
from observer.truth.alignment.observed import ObservedRun
from observer.truth.alignment.result import Alignment
from observer.truth.motion_capture import BodySample, Capture, Trajectory

WINDOW_S = 180.0
# Between two solutions, seconds of the source's clock.
SOLVE_EVERY_S = 2.0
# A source is as fast as 60 frames a second, motion capture as 500 samples.
_MOST_LINES, _MOST_SAMPLES = 60 * 180, 500 * 180
_NONE_YET = "not yet aligned: nothing has been recorded on both sides yet"


class OnlineAlignment:
    """Keeps what came last and aligns it; no thread and no clock of its own.

    Args:
        choices: as for ``align``; ``search`` should be given where a server's clock is fitted.
        to_host: from a sample to the time it is aligned by, seconds; its own stamp by default.

    Attributes:
        state: the alignment, or one sentence that begins with "not yet aligned".
        truth: the last minutes as truth; None as long as nothing is aligned.
    """

    def __init__(
        self,
        choices: AlignmentChoices | None = None,
        to_host: Callable[[BodySample], float] | None = None,
    ) -> None:
        self.choices = choices or AlignmentChoices()
        self._to_host = to_host or _own_stamp
        self._lines: deque[Mapping[str, Any]] = deque(maxlen=_MOST_LINES)
        self._samples: dict[str, deque[tuple[float, BodySample]]] = {}
        self._solved: float | None = None
        self.state: Alignment | str = _NONE_YET
        self.truth: AlignedTruth | None = None

    def add_observation(self, line: Mapping[str, Any]) -> None:
        """One line as ``observer.jsonl.observation_line`` makes it."""
        if self._lines and float(line["time"]) < float(self._lines[-1]["time"]):
            # The source began again: its clock and world are others.
            self._lines.clear()
            self._solved = None
            self.state, self.truth = _NONE_YET, None
        self._lines.append(line)
        oldest = float(line["time"]) - WINDOW_S
        while float(self._lines[0]["time"]) < oldest:
            self._lines.popleft()

    def add_samples(self, samples: Iterable[BodySample]) -> None:
        """Samples of a live server, by rising time for each body; older ones are dropped."""
        for sample in samples:
            kept = self._samples.setdefault(sample.name, deque(maxlen=_MOST_SAMPLES))
            time = self._to_host(sample)
            if kept and time <= kept[-1][0]:
                continue
            kept.append((time, sample))
            while kept[0][0] < time - WINDOW_S:
                kept.popleft()

    def solve(self) -> bool:
        """Align anew if two seconds have passed since the last time; whether it was tried.

        It takes from tenths of a second to seconds, so the caller does it beside the frames. What
        is refused for a moment, as when the robot stands for minutes, leaves what was found.
        """
        if not self._lines or not self._samples:
            return False
        now = float(self._lines[-1]["time"])
        if self._solved is not None and now - self._solved < SOLVE_EVERY_S:
            return False
        self._solved = now
        capture = self.capture()
        try:
            found = align(ObservedRun.of_lines(self._lines), capture, self.choices)
        except TruthError as error:
            if not isinstance(self.state, Alignment):
                self.state = f"not yet aligned: {error}"
                return True
            found = self.state
        self.state = found
        self.truth = AlignedTruth(capture, found, self.choices.sizes)
        return True

    def capture(self) -> Capture:
        """The last minutes of all bodies."""
        return Capture(
            "live",
            None,
            {name: _trajectory(name, list(kept)) for name, kept in self._samples.items()},
        )


def _own_stamp(sample: BodySample) -> float:
    return sample.time


def _trajectory(name: str, kept: list[tuple[float, BodySample]]) -> Trajectory:
    unknown = np.full(3, np.nan)
    positions = [unknown if s.position is None else s.position for _, s in kept]
    rotations = None
    if any(s.rotation is not None for _, s in kept):
        lost = np.full((3, 3), np.nan)
        rotations = np.array([lost if s.rotation is None else s.rotation for _, s in kept])
    return Trajectory(name, np.array([t for t, _ in kept]), np.array(positions), rotations)
