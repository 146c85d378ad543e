"""Time within a run and the run's length; no other module computes it."""

from __future__ import annotations

from collections.abc import Iterable

from observer.recording.payloads import RecordedFrame

# A replaced engine reopens its source. If the source's time then differs by more than this from
# what the host's clock predicts, the source's clock has restarted.
_ANOTHER_CLOCK_S = 1.0


class RunTime:
    """Clock of a run: its source's, continued across restarts of the source's clock.

    A run's length is that of the observed time: from its first recorded frame to its last one, on
    the source's clock. So neither a busy machine nor the playback speed changes it. Gaps without
    frames count; at a restart of the clock the gap is unknown and counts as one frame interval.

    Attributes:
        begin_s: source's time of the first frame, None before it.
        duration_s: since then, None without a frame.
        offset_s: run's clock minus the source's, at the newest frame.
    """

    def __init__(self) -> None:
        self.begin_s: float | None = None
        self.duration_s: float | None = None
        self.offset_s = 0.0
        self._time = self._received = self._step = 0.0

    def add(self, time: float, received: float, *, reopened: bool = False) -> float:
        """Add the next frame and return its time within the run.

        Args:
            time, received: of the frame, on the source's and the host's monotonic clock, seconds.
            reopened: whether the source was reopened for this frame.
        """
        if self.duration_s is None:
            self.begin_s, self.duration_s = time, 0.0
        else:
            step, passed = time - self._time, received - self._received
            if step <= 0 or (reopened and abs(step - passed) > _ANOTHER_CLOCK_S):
                self.offset_s += self._step - step
                step = self._step
            self.duration_s += step
            self._step = step
        self._time, self._received = time, received
        return time + self.offset_s

    @staticmethod
    def of_frames(frames: Iterable[RecordedFrame]) -> RunTime:
        """Return the clock of a recording at its last frame."""
        clock = RunTime()
        for frame in frames:
            clock.add_recorded(frame)
        return clock

    def add_recorded(self, frame: RecordedFrame) -> float:
        """Add a recorded frame and return its time within the run."""
        return self.add(frame.time, frame.received, reopened=frame.begins == "observer")
