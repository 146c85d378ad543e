"""``/api/live``: telemetry to any number of pages, newest first, never more than they can take.

Every message is encoded once for all pages. A page has at most two unacknowledged observations;
meanwhile newer ones replace each other and count as dropped. So a slow page sees fewer frames,
never older ones, and does not slow down the others; one that acknowledges late gets half as many,
see ``app.http.sockets.budget``.
"""

from __future__ import annotations

import asyncio
import contextlib
from dataclasses import dataclass

from fastapi import WebSocket

from app.contract.events import ObservationEvent
from app.contract.robots import WheelSpeed
from app.contract.sockets import (
    HEARTBEAT_S,
    HeartbeatMessage,
    LogMessage,
    ObservationTold,
    RobotsTold,
    StatusMessage,
)
from app.contract.values import filled, json_text, word
from app.http.sockets.budget import Budget
from app.http.sockets.connections import BadMessage, json_object, receive_text, until_one_ends
from app.server import Server
from app.server.journal import Journal
from app.server.status import observation_age_s, status

_STATUS_INTERVAL_S = 0.5
_MOST_UNACKNOWLEDGED = 2
# Time after which a missing acknowledgement is given up (a background tab paints nothing).
_ACKNOWLEDGE_WITHIN_S = 5.0
# Interval between messages on robots: with robots, and without.
_ROBOTS_INTERVAL_S = 0.1
_NO_ROBOTS_INTERVAL_S = 0.5


@dataclass(frozen=True)
class _Observation:
    """Observation, encoded except for its age.

    Attributes:
        sequence: counted by the server over all engines, from 1.
    """

    sequence: int
    received: float
    text: str

    def message(self, now: float) -> str:
        age_ms = max(0.0, 1000.0 * (now - self.received))
        return f'{self.text},"age_ms":{age_ms:.1f}}}'


class LiveHub:
    """Encoder of events that passes them to the pages; follows the server while open.

    Args:
        journal: the log, which is followed too.
    """

    def __init__(self, server: Server, journal: Journal) -> None:
        self._server = server
        self._journal = journal
        self._pages: set[_Page] = set()
        self._newest: _Observation | None = None
        self._event: ObservationEvent | None = None
        self._sequence = 0
        self._status_due = asyncio.Event()
        self._status_text: str | None = None
        self._robots_later: asyncio.TimerHandle | None = None
        self._robots_sent_at = -_NO_ROBOTS_INTERVAL_S
        self._robots_text: str | None = None

    async def run(self) -> None:
        """Run until cancelled."""
        unfollow = self._server.followers.follow(self)
        self._journal.changed = self._logged
        try:
            while True:
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(_STATUS_INTERVAL_S):
                        await self._status_due.wait()
                self._status_due.clear()
                self._status_text = None
                for page in self._pages:
                    page.status_changed()
                # Sent at most 20 times a second, however much changes.
                await asyncio.sleep(0.05)
        finally:
            unfollow()
            if self._robots_later is not None:
                self._robots_later.cancel()

    # --- follower of the server -------------------------------------------------------------

    def observed(self, event: ObservationEvent) -> None:
        self._sequence += 1
        self._event, self._newest = event, None
        for page in self._pages:
            page.observed()

    def status_changed(self) -> None:
        self._status_due.set()

    def _logged(self) -> None:
        for page in self._pages:
            page.logged()

    def robots_changed(self) -> None:
        if self._robots_later is not None:
            return
        connected = self._server.driving.connected
        interval = _ROBOTS_INTERVAL_S if connected else _NO_ROBOTS_INTERVAL_S
        wait = max(0.0, self._robots_sent_at + interval - self._server.clock())
        self._robots_later = asyncio.get_running_loop().call_later(wait, self._tell_robots)

    def _tell_robots(self) -> None:
        self._robots_later = None
        self._robots_sent_at = self._server.clock()
        self._robots_text = None
        for page in self._pages:
            page.robots_changed()

    # --- for the pages -----------------------------------------------------------------------

    @property
    def has_current(self) -> bool:
        """Return whether the newest observation comes from the source that is open."""
        return self._event is not None and self._event is self._server.source.latest

    @property
    def newest(self) -> _Observation | None:
        """Return the newest observation; encode it when the first page asks for it."""
        if self._newest is None and self._event is not None:
            event = self._event
            text = json_text(ObservationTold(self._sequence, event.line, event.truth))
            self._newest = _Observation(self._sequence, event.received, text[:-1])
        return self._newest

    @property
    def status_text(self) -> str:
        """Return the status as one message."""
        if self._status_text is None:
            self._status_text = json_text(StatusMessage(**vars(status(self._server))))
        return self._status_text

    def robots_text(self, after: int) -> tuple[str, int]:
        """Return the robots as one message, and the number of the newest speed in it.

        Args:
            after: the number of the newest speed that the page has.
        """
        driving = self._server.driving
        if self._robots_text is None:
            self._robots_text = json_text(RobotsTold(**vars(driving.facts())))
        # The part common to all pages is encoded once; the rest is small.
        wheels = ",".join(
            json_text(filled(WheelSpeed, sample, time=round(sample.time, 4)))
            for sample in driving.wheels.since(after)
        )
        return f'{self._robots_text[:-1]},"wheels":[{wheels}]}}', driving.wheels.newest

    @property
    def newest_entry(self) -> int:
        """Return the number of the log's newest entry."""
        return self._journal.newest

    def log_text(self, after: int) -> str:
        """Return the log's entries above a number as one message."""
        return json_text(LogMessage(self._journal.since(after)))

    async def serve(self, socket: WebSocket) -> None:
        """Serve one page until it leaves."""
        page = _Page(self, self._server, socket)
        self._pages.add(page)
        self._server.viewers += 1
        try:
            await until_one_ends(socket, page.send(), page.read())
        finally:
            self._pages.discard(page)
            self._server.viewers -= 1
            self.status_changed()


class _Page:
    """State of one socket."""

    def __init__(self, hub: LiveHub, server: Server, socket: WebSocket) -> None:
        self._hub = hub
        self._server = server
        self._socket = socket
        self._wake = asyncio.Event()
        self._status_due = True
        self._robots_due = True
        self._wheels_sent = server.driving.wheels.newest
        # Pages request earlier log entries themselves.
        self._log_sent = hub.newest_entry
        self._budget = Budget(server.clock)
        # A page opened while playback is paused shows the current frame.
        self._observation_due = hub.has_current
        # Sequence -> (received, sent), on the monotonic clock.
        self._unacknowledged: dict[int, tuple[float, float]] = {}

    def status_changed(self) -> None:
        self._status_due = True
        self._wake.set()

    def robots_changed(self) -> None:
        self._robots_due = True
        self._wake.set()

    def logged(self) -> None:
        self._wake.set()

    def observed(self) -> None:
        if self._observation_due:
            self._server.telemetry.live_messages_dropped += 1
        self._observation_due = True
        self._wake.set()

    async def send(self) -> None:
        """Send what is due; while the network is slow, keep only the newest."""
        beat = -HEARTBEAT_S
        while True:
            now = self._server.clock()
            if now - beat >= HEARTBEAT_S:
                beat = now
                await self._socket.send_text(self._heartbeat(now))
                continue
            text = self._next(now)
            if text is not None:
                await self._socket.send_text(text)
                continue
            self._wake.clear()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(self._pause_s(HEARTBEAT_S - (now - beat))):
                    await self._wake.wait()

    def _pause_s(self, until_beat_s: float) -> float:
        """Return how long to wait unless something happens before."""
        if self._observation_due and (held_s := self._budget.wait_s) > 0:
            return min(until_beat_s, held_s)
        return until_beat_s

    def _next(self, now: float) -> str | None:
        if self._status_due:
            self._status_due = False
            return self._hub.status_text
        if self._robots_due:
            self._robots_due = False
            text, self._wheels_sent = self._hub.robots_text(self._wheels_sent)
            return text
        if self._log_sent < self._hub.newest_entry:
            after, self._log_sent = self._log_sent, self._hub.newest_entry
            return self._hub.log_text(after)
        self._give_up_old(now)
        if self._budget.wait_s > 0:
            return None
        if not self._observation_due or len(self._unacknowledged) >= _MOST_UNACKNOWLEDGED:
            return None
        self._observation_due = False
        newest = self._hub.newest
        if newest is None:
            return None
        self._unacknowledged[newest.sequence] = (newest.received, now)
        self._budget.sent()
        return newest.message(now)

    def _give_up_old(self, now: float) -> None:
        old = [
            sequence
            for sequence, (_, sent) in self._unacknowledged.items()
            if now - sent > _ACKNOWLEDGE_WITHIN_S
        ]
        for sequence in old:
            del self._unacknowledged[sequence]
            self._budget.acknowledged(_ACKNOWLEDGE_WITHIN_S)

    def _heartbeat(self, now: float) -> str:
        state = word(self._server.source.state.state)
        return json_text(HeartbeatMessage(round(now, 3), observation_age_s(self._server), state))

    async def read(self) -> None:
        """Read acknowledgements."""
        while True:
            sequence = _painted(await receive_text(self._socket))
            received = self._unacknowledged.pop(sequence, None)
            # An observation never sent or given up says nothing about latency.
            if received is not None:
                now = self._server.clock()
                self._server.telemetry.painted(now - received[0])
                self._budget.acknowledged(now - received[1])
                self._wake.set()


def _painted(text: str) -> int:
    """Return the sequence of a ``painted`` message.

    Raises:
        BadMessage: it is not such a message.
    """
    expected = 'send {"type": "painted", "sequence": NUMBER}'
    message = json_object(text, expected)
    if message.get("type") != "painted":
        raise BadMessage(expected)
    sequence = message.get("sequence")
    if not isinstance(sequence, int) or isinstance(sequence, bool):
        raise BadMessage(expected)
    return sequence
