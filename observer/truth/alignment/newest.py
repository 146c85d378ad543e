"""Motion capture as ground truth for the newest frames, as far as samples have arrived.

Nothing is extrapolated: neither gaps nor samples that are still to come are bridged.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from observer.geometry import Float64Array, Pose
from observer.truth.alignment.aligned import VELOCITY_SMOOTHING_S, State, numbered, placed_body
from observer.truth.alignment.curves import GAP_INTERVALS
from observer.truth.alignment.live_clocks import LiveClocks
from observer.truth.alignment.result import Alignment
from observer.truth.alignment.rooms import body_poses, centre_positions
from observer.truth.contract import TrueBody
from observer.truth.motion_capture import BodySample, Trajectory, trajectory_of

# Seconds: truth is asked for within this time of a frame's exposure.
_KEPT_S = 2.0
_MOST_KEPT = 1000
# Samples of each body that are used around one instant.
_MOST_LOOKED_AT = 160
# The velocity is a parabola's, over ``VELOCITY_SMOOTHING_S`` or, if longer, this many samples.
_FEWEST = 5
# An instant needs this many later samples, as a parabola is uncertain at its end.
_BEHIND = 3
# Seconds: an older instant would no longer represent the same moment.
_OLDEST_S = 0.1
_REACH_S = _OLDEST_S + VELOCITY_SMOOTHING_S


@dataclass(frozen=True, eq=False)
class TimedBody:
    """A body at the instant it was measured.

    Attributes:
        time: seconds on the source's clock.
    """

    time: float
    body: TrueBody


class NewestTruth:
    """Keeps the last two seconds of each body; it has no thread and reads no clock itself."""

    def __init__(self) -> None:
        self._samples: dict[str, deque[BodySample]] = {}
        # By body, on the server's clock: the last instant returned, so that none is repeated.
        self._returned: dict[str, float] = {}

    def add(self, samples: Iterable[BodySample]) -> None:
        """Add samples as ``LiveCapture.drain`` returns them."""
        for sample in samples:
            kept = self._samples.setdefault(sample.name, deque(maxlen=_MOST_KEPT))
            kept.append(sample)
            while kept[0].time < sample.time - _KEPT_S:
                kept.popleft()

    def bodies(
        self,
        alignment: Alignment,
        clocks: LiveClocks,
        T_world_room: Pose,
        time: float,
    ) -> tuple[TimedBody, ...]:
        """Return every body that was measured at ``time`` (source clock), the observer first.

        If later samples have not arrived yet, it may be an instant up to 0.1 s before ``time``. No
        instant is returned twice.

        Args:
            T_world_room: of the current segment.
        """
        found = []
        for number, name in numbered(alignment.roles, alignment.roles):
            measured = self._measured(name, alignment, clocks, time)
            if measured is None:
                continue
            at, state = measured
            body = placed_body(number, name, alignment.roles[name], state, T_world_room)
            found.append(TimedBody(at, body))
        return tuple(found)

    def room_camera(self, alignment: Alignment, clocks: LiveClocks, time: float) -> Pose | None:
        """Return ``T_room_camera`` at ``time`` (source clock); None without a measurement there."""
        name, T_body_camera = alignment.observer, alignment.T_body_camera
        if name is None or T_body_camera is None:
            return None
        stamp = _stamps(alignment, clocks, time)
        body = self._around(name, stamp)
        if body is None:
            return None
        pose = body_poses(body, np.array([stamp]))[0]
        return Pose.from_matrix(pose) @ T_body_camera if np.isfinite(pose).all() else None

    def _measured(
        self, name: str, alignment: Alignment, clocks: LiveClocks, time: float
    ) -> tuple[float, State] | None:
        """Return the instant on the source's clock, and the state in the room."""
        wanted = _stamps(alignment, clocks, time)
        body = self._around(name, wanted)
        if body is None:
            return None
        stamp = min(wanted, float(body.times[-1 - _BEHIND]))
        if wanted - stamp > _OLDEST_S or stamp <= self._returned.get(name, -math.inf):
            return None
        offset = alignment.centre(name)
        at = np.array([stamp])
        place = centre_positions(body, at, offset)[0]
        velocity = _velocity(body, offset, stamp)
        if velocity is None or not np.isfinite(place).all():
            return None
        self._returned[name] = stamp
        velocity = velocity / (1 + 1e-6 * alignment.time.drift_ppm)
        heading = velocity if body.rotations is None else body_poses(body, at)[0, :3, 0]
        instant = time if stamp == wanted else time - (wanted - stamp)
        return instant, (place, velocity, heading)

    def _around(self, name: str, stamp: float) -> Trajectory | None:
        """Return the samples around an instant on the server's clock."""
        kept = self._samples.get(name)
        if not kept:
            return None
        chosen: list[BodySample] = []
        for sample in reversed(kept):
            if sample.time < stamp - _REACH_S or len(chosen) >= _MOST_LOOKED_AT:
                break
            if sample.time < stamp + _REACH_S:
                chosen.append(sample)
        chosen.reverse()
        if len(chosen) < _FEWEST:
            return None
        return trajectory_of(name, chosen)


def _stamps(alignment: Alignment, clocks: LiveClocks, time: float) -> float:
    """Convert ``time`` on the source's clock to the server's clock."""
    return float(clocks.to_server(alignment.time.to_truth(np.array([time])))[0])


def _velocity(body: Trajectory, centre: Float64Array | None, stamp: float) -> Float64Array | None:
    """Return the velocity (3,) m/s, room; None with too few gapless samples around it."""
    times, places = body.times, body.fixed_points(centre)
    interval = float(np.median(np.diff(times)))
    half = max(VELOCITY_SMOOTHING_S / 2, interval * _FEWEST / 2)
    index = int(np.searchsorted(times, stamp))
    if index >= len(times):
        return None
    first = last = index
    known = np.atleast_1d(np.isfinite(places).all(axis=1))
    widest = GAP_INTERVALS * interval
    while first > 0 and known[first - 1] and times[first] - times[first - 1] <= widest:
        if stamp - times[first - 1] > half:
            break
        first -= 1
    while last < len(times) and known[last]:
        if times[last] - stamp > half or (last > index and times[last] - times[last - 1] > widest):
            break
        last += 1
    if last - first < _FEWEST:
        return None
    since = times[first:last] - stamp
    terms = np.stack([np.ones_like(since), since, since**2], axis=1)
    fitted, *_ = np.linalg.lstsq(terms, places[first:last], rcond=None)
    return np.asarray(fitted[1])
