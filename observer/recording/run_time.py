"""Time within a run, and with it the run's length: the one place that says how long a run is."""

from __future__ import annotations

from collections.abc import Iterable

from observer.recording.payloads import RecordedFrame

# An engine that was replaced opens its source anew. Frames this much earlier or later than the
# host's clock lets expect are then on another clock.
_ANOTHER_CLOCK_S = 1.0


class RunTime:
    """Clock of a run: its source's, continued where the source began its clock anew.

    A run is as long as what was observed: from its first kept frame to its last one, on the
    source's clock. So neither a busy machine nor the pace of playback changes it. A gap without
    frames counts; where the clock began anew, the gap is unknown and counts as one frame's step.

    Attributes:
        begin_s: source's time of the first frame, None before it.
        duration_s: since then, None without a frame.
        offset_s: of the run's clock to the source's at the newest frame.
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
            reopened: the source was opened anew for this frame.
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
