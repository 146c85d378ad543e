"""Goal of the observer at each frame of a run."""

from __future__ import annotations

from bisect import bisect_left
from typing import Any, Final

from pydantic import TypeAdapter, ValidationError

from app.contract.robots import GoalNow
from observer.recording.payloads import RecordedFrame
from observer.recording.reader import Recording
from observer.rig.rig import OBSERVER

# A robot reports ten times a second; reports further away in time than this are ignored.
_FRESH_S: Final = 0.5
_GOAL = TypeAdapter(GoalNow)


class Goals:
    """Goals that a recording holds in the reports of the observer's robot."""

    def __init__(self, recording: Recording) -> None:
        self._times: list[float] = []
        self._facts: list[Any] = []
        for row in recording.robot_rows():
            if row.role == OBSERVER:
                self._times.append(row.received)
                self._facts.append(row.facts.get("goal"))

    def of(self, frame: RecordedFrame) -> GoalNow | None:
        """Return the goal in the report nearest in time; None if there was none."""
        after = bisect_left(self._times, frame.received)
        near = [at for at in (after - 1, after) if 0 <= at < len(self._times)]
        gaps = {at: abs(self._times[at] - frame.received) for at in near}
        at = min(gaps, key=gaps.__getitem__, default=None)
        if at is None or gaps[at] > _FRESH_S or self._facts[at] is None:
            return None
        try:
            return _GOAL.validate_python(self._facts[at])
        except ValidationError:
            # Recorded by a version with other fields.
            return None
