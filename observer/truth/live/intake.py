"""Intake of poses from all protocols: gaps, scale, stamps, and the queue for other threads."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from observer.geometry import Float64Array
from observer.truth.files.units import MOST_METRES, ROOM_M, too_far_for_a_room
from observer.truth.live.clock import ClockFitter
from observer.truth.live.contract import MOST_BODIES, MOST_KEPT, LiveCaptureReport, LiveState
from observer.truth.live.stamps import StampReader
from observer.truth.motion_capture import SAME_INSTANT_S, BodySample

# Without a pose for this long, nothing is being received.
_QUIET_S = 1.0
_RATE_OVER_S = 3.0
# Metres: a server that sends metres instead of millimetres stays within this.
_NEAR_M = 0.02
_SCALE_AFTER = 100

# Name, position and rotation.
_Pose = tuple[str, Float64Array | None, Float64Array | None]


@dataclass(eq=False)
class _Body:
    """State of one body."""

    pose: tuple[float, ...] | None = None
    time: float | None = None
    # Time of arrival, and whether the body was seen.
    lately: deque[tuple[float, bool]] = field(default_factory=lambda: deque(maxlen=4096))


class Intake:
    """Takes poses from the listening thread and hands samples to any other thread.

    Args:
        counts: stamps are frame numbers. millimetres: this is the protocol's unit, for messages.
        clock: host's monotonic clock.
    """

    def __init__(
        self, clock: Callable[[], float], *, counts: bool = False, millimetres: bool = False
    ) -> None:
        self._clock = clock
        self._millimetres = millimetres
        self._lock = threading.Lock()
        self._samples: deque[BodySample] = deque()
        self._bodies: dict[str, _Body] = {}
        self._notes: dict[str, str] = {}
        self._stamps: StampReader[_Pose] = StampReader(self._note, counts=counts)
        self._fitter = ClockFitter()
        self._dropped = self._unreadable = self._connections = 0
        self._trouble: str | None = "the connection is being opened"
        self._connected = False
        self._last_pose: float | None = None
        self._since_connected = 0.0
        self._farthest_m = 0.0
        self._poses = 0

    # --- the listening thread -----------------------------------------------------------------

    def connected(self) -> None:
        """Note that a sender has been reached."""
        with self._lock:
            self._connected, self._trouble = True, None
            self._connections += 1
            self._since_connected = self._clock()
            self._stamps.restart()

    def waiting(self) -> None:
        """Note that the port is open, but nothing has been received yet."""
        with self._lock:
            self._connected, self._trouble = True, None
            self._since_connected = self._clock()

    def lost(self, sentence: str) -> None:
        """Note that no sender is reached, and why."""
        with self._lock:
            self._connected, self._trouble = False, sentence
            # Notes about a server end with its connection.
            self._notes.clear()
            self._farthest_m, self._poses = 0.0, 0

    def malformed(self) -> None:
        """Count a message that could not be read."""
        with self._lock:
            self._unreadable += 1

    def note(self, kind: str, sentence: str) -> None:
        """Keep a note for people; it replaces the last one of its kind."""
        with self._lock:
            self._note(kind, sentence)

    def pose(
        self,
        name: str,
        stamp: float,
        received: float,
        numbers: tuple[float, ...],
        position: Float64Array,
        rotation: Float64Array | None,
    ) -> None:
        """Take a body's pose as it arrived.

        Args:
            numbers: the pose as in the message. A pose that equals the previous one, has a zero
                position, is not finite or lies beyond ``MOST_METRES`` is a gap: no measurement
                repeats to the last digit.
            position: (3,) metres. rotation: (3, 3) ``R_room_body``, None if it has none.
        """
        with self._lock:
            body = self._bodies.get(name)
            if body is None:
                if len(self._bodies) >= MOST_BODIES:
                    most = f"more than {MOST_BODIES} bodies are sent; the rest are ignored"
                    self._note("bodies", most)
                    return
                body = self._bodies[name] = _Body()
            seen = bool(np.isfinite(numbers).all()) and any(position) and numbers != body.pose
            if seen:
                self._look_at_scale(position)
                seen = float(np.abs(position).max()) <= MOST_METRES
            body.pose = numbers
            body.lately.append((received, seen))
            self._last_pose = received
            item = (name, position, rotation) if seen else (name, None, None)
            self._queue(stamp, received, item)

    def _queue(self, stamp: float, received: float, item: _Pose) -> None:
        for timed in self._stamps.feed(stamp, received, item):
            self._fitter.add(timed.time, timed.received)
            name, position, rotation = timed.item
            known = self._bodies[name]
            # A stamp that repeats or arrives out of order adds nothing.
            if known.time is not None and timed.time <= known.time + SAME_INSTANT_S:
                continue
            known.time = timed.time
            if len(self._samples) >= MOST_KEPT:
                self._samples.popleft()
                self._dropped += 1
            self._samples.append(BodySample(name, timed.time, timed.received, position, rotation))

    def _look_at_scale(self, position: Float64Array) -> None:
        self._poses += 1
        self._farthest_m = max(self._farthest_m, float(np.abs(position).max()))
        if "scale" in self._notes:
            return
        if self._farthest_m > ROOM_M:
            unit, times = ("mm", 1000) if self._millimetres else ("m", 1)
            self._note(
                "scale",
                f"{too_far_for_a_room(f'{self._farthest_m * times:.4g} {unit}')}: the server seems "
                f"to send a smaller unit; set it to {unit}",
            )
        elif self._millimetres and self._poses == _SCALE_AFTER and self._farthest_m < _NEAR_M:
            self._note(
                "scale",
                f"every body stays within {self._farthest_m * 1000:.3g} mm of the origin: the "
                "server seems to send metres; set it to mm",
            )

    def _note(self, kind: str, sentence: str) -> None:
        # Keep only the newest of a kind, so that a clock that jumps every minute needs no memory.
        self._notes[kind] = sentence

    # --- any thread ---------------------------------------------------------------------------

    def drain(self) -> tuple[BodySample, ...]:
        """Return the samples; see ``LiveCapture.drain``."""
        with self._lock:
            ready = tuple(self._samples)
            self._samples.clear()
        return ready

    def report(self) -> LiveCaptureReport:
        """Return the state; see ``LiveCapture.report``."""
        now = self._clock()
        with self._lock:
            rates, seen = self._rates(now)
            state, trouble = self._state(now)
            return LiveCaptureReport(
                state=state,
                trouble=trouble,
                notes=tuple(
                    sentence
                    for kind, sentence in self._notes.items()
                    if kind != "clock" or state == "receiving"
                ),
                rate_hz=rates,
                seen=seen,
                dropped=self._dropped,
                malformed=self._unreadable,
                connections=self._connections,
                clock=self._fitter.fit(),
            )

    def _state(self, now: float) -> tuple[LiveState, str | None]:
        if not self._connected:
            return "connecting", self._trouble
        if self._last_pose is not None and now - self._last_pose < _QUIET_S:
            return "receiving", self._trouble
        if now - self._since_connected < _QUIET_S:
            return "waiting", self._trouble
        quiet = "no poses received; check that bodies are tracked and streamed"
        return "waiting", self._trouble or quiet

    def _rates(self, now: float) -> tuple[dict[str, float], dict[str, float]]:
        rates, shares = {}, {}
        for name, body in self._bodies.items():
            while body.lately and now - body.lately[0][0] > _RATE_OVER_S:
                body.lately.popleft()
            if len(body.lately) > 1:
                over = body.lately[-1][0] - body.lately[0][0]
                rates[name] = (len(body.lately) - 1) / over if over > 0 else 0.0
                shares[name] = sum(each[1] for each in body.lately) / len(body.lately)
            else:
                rates[name] = shares[name] = 0.0
        return rates, shares
