"""The engine's main loop: commands, paced playback, observing, publishing, heartbeats.

One thread does all of it, so a heartbeat says that this very loop is alive. Only opening a
source, which may take long, has a thread of its own.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

from app.engine.calibration_preview import preview_calibration
from app.engine.errors import NotNow
from app.engine.explaining import Explainer, ego_motion_facts
from app.engine.opening import Opening
from app.engine.publishing import Publisher
from app.engine.session import (
    NotCalibrated,
    ObserverFactory,
    Session,
    SourceOpener,
    open_session,
    parse_parameters,
)
from app.engine.watched import Observed
from app.messages import (
    CloseSource,
    EngineState,
    ExplainPixel,
    HeartbeatEvent,
    ObservationEvent,
    OpenSource,
    PreviewCalibration,
    Reply,
    Request,
    SetParameters,
    SetPlayback,
    Shutdown,
    SkippedFrameEvent,
    StateEvent,
    StopRun,
    WatchViews,
)
from observer.errors import DynamicObserverError, InputError
from observer.jsonl import observation_line
from observer.types import FullTrace, StereoFrame

_log = logging.getLogger(__name__)

# Twice as often as promised, so that a little lateness keeps the promise.
BEAT_INTERVAL_S = 0.05
# How often the page hears of the playback's position alone.
_POSITION_INTERVAL_S = 0.5


# What the loop waits for: requests, an opening that is done, or None to leave.
Inbox = queue.SimpleQueue[Request | Opening | None]


class Engine:
    """Answers commands and observes the open source until told to leave."""

    def __init__(
        self,
        *,
        inbox: Inbox,
        send: Callable[[object], None],
        observations_lost: Callable[[], int],
        publisher: Publisher,
        open_source: SourceOpener,
        make_observer: ObserverFactory,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        Args:
            inbox: filled by whoever receives requests; None in it ends the loop.
            send: takes replies and events and never blocks.
            observations_lost: how many events ``send`` dropped so far.
            publisher: takes what was observed, for views and the cloud.
            clock: the host's monotonic clock.
        """
        self._inbox = inbox
        self._send = send
        self._observations_lost = observations_lost
        self._publisher = publisher
        self._open_source = open_source
        self._make_observer = make_observer
        self._clock = clock
        self._thread = threading.get_ident()
        self._session: Session | None = None
        self._opening: Opening | None = None
        self._failed: StateEvent | None = None
        self._raw_pair: StereoFrame | None = None
        self._explainer = Explainer()
        self._sequence = 0
        self._leaving = False
        self._next_beat = 0.0
        self._sent_state: StateEvent | None = None
        self._state_sent_at = 0.0

    def run(self) -> None:
        """Work until ``Shutdown``, or None in the inbox; call it in the loop's own thread."""
        self._thread = threading.get_ident()
        self._publish_state()
        try:
            while not self._leaving:
                self._take_messages()
                self._advance()
                self._publish_state()
        finally:
            self._close_session()

    def beat(self) -> None:
        """Send a heartbeat if one is due. Only the loop's own thread beats; others do nothing."""
        now = self._clock()
        if now < self._next_beat or threading.get_ident() != self._thread:
            return
        self._next_beat = now + BEAT_INTERVAL_S
        self._send(HeartbeatEvent(now, {"observations_lost": self._observations_lost()}))

    def _beating_clock(self) -> float:
        # The observer reads its clock between its stages, so that even a slow frame beats while
        # it makes progress, and only a stage that hangs looks like one.
        self.beat()
        return time.perf_counter()

    # --- waiting and commands --------------------------------------------------------------

    def _take_messages(self) -> None:
        """Wait until a frame is due or a message is there; answer all messages."""
        while not self._leaving:
            self.beat()
            now = self._clock()
            due = self._due_in_s(now)
            wait = min(due, max(self._next_beat - now, 0.0))
            try:
                message = self._inbox.get(timeout=wait) if wait else self._inbox.get_nowait()
            except queue.Empty:
                if due <= wait:
                    return
                self._publish_state()
                continue
            if message is None:
                self._leaving = True
            elif isinstance(message, Opening):
                self._opened(message)
            else:
                self._answer(message)
                self._publish_state()

    def _due_in_s(self, now: float) -> float:
        if self._session is None:
            return float("inf")
        player = self._session.player
        if player.wants_reading:
            return 0.0
        wait = player.wait_s(now)
        return float("inf") if wait is None else wait

    def _answer(self, request: Request) -> None:
        command = request.command
        try:
            if isinstance(command, OpenSource):
                self._begin_opening(request, command)
                return
            value = self._handle(command)
        except DynamicObserverError as error:
            self._send(_refusal(request.number, error))
        except Exception as error:  # noqa: BLE001
            # The border of the process: whatever a command runs into, the engine stays alive
            # and says so.
            _log.exception("%s failed", type(command).__name__)
            self._send(Reply(request.number, error=_unexpected(error), refusal="failure"))
        else:
            self._publish_state()
            self._send(Reply(request.number, value=value))

    def _handle(self, command: object) -> dict[str, Any]:
        match command:
            case StopRun():
                return self._stop_run()
            case CloseSource():
                self._abandon_opening()
                self._close_session()
                self._failed = None
                return {}
            case SetParameters():
                return self._set_parameters(command)
            case SetPlayback():
                return self._set_playback(command)
            case WatchViews():
                self._publisher.watch(command.names)
                return {}
            case PreviewCalibration():
                return self._preview(command.calibration_yaml)
            case ExplainPixel():
                return self._explainer.explain(command.u, command.v)
            case Shutdown():
                self._leaving = True
                return {}
        raise InputError(f"the engine knows no command {type(command).__name__}")

    def _stop_run(self) -> dict[str, Any]:
        if self._session is None or self._session.run_id is None:
            raise NotNow("no run is going; start one first")
        self._session.run_id = None
        return {}

    def _set_parameters(self, command: SetParameters) -> dict[str, Any]:
        parameters = parse_parameters(command.parameters)
        if self._opening is not None:
            self._opening.parameters = (parameters, command.revision)
        if self._session is None:
            return {"frame": None}
        self._session.use(parameters, command.revision)
        return {"frame": self._session.player.next_index}

    def _set_playback(self, command: SetPlayback) -> dict[str, Any]:
        session = self._session
        if session is None:
            raise NotNow("no source is open, so there is nothing to play; open one first")
        session.player.change(
            paused=command.paused,
            rate=command.rate,
            loop=command.loop,
            step=command.step,
            restart=command.restart,
        )
        return session.playback_facts(self._clock())

    def _preview(self, calibration_yaml: str) -> dict[str, Any]:
        pair = self._raw_pair
        if self._session is not None and self._session.player.position is None:
            pair = self._session.player.held or pair
        if pair is None:
            raise NotNow("there is no image to try the calibration on; open a source first")
        return preview_calibration(pair, calibration_yaml, self.beat).reply()

    # --- opening and closing ---------------------------------------------------------------

    def _begin_opening(self, request: Request, command: OpenSource) -> None:
        if self._opening is not None:
            raise NotNow(
                f"{self._opening.command.source} is being opened; wait for it, or close the source"
            )
        if self._session is not None and self._session.run_id is not None:
            raise NotNow("a run is going; stop it before another source is opened")
        self._opening = Opening(request, command)
        self._opening.start(
            lambda: open_session(
                command, self._open_source, self._make_observer, self._beating_clock
            ),
            self._inbox.put,
        )

    def _opened(self, opening: Opening) -> None:
        number, command = opening.request.number, opening.command
        if opening.abandoned:
            if opening.session is not None:
                opening.session.close()
            return
        self._opening = None
        session, error = opening.session, opening.error
        if session is None:
            if isinstance(error, NotCalibrated) and error.pair is not None:
                self._raw_pair = error.pair
            if isinstance(error, DynamicObserverError):
                reply = _refusal(number, error)
            else:
                _log.error("opening %s failed", command.source, exc_info=error)
                what = f"opening {command.source} failed: {_unexpected(error)}"
                reply = Reply(number, error=what, refusal="failure")
            if self._session is None:
                self._failed = StateEvent(
                    EngineState.FAILED, reply.error, run_id=command.run_id, segment=command.segment
                )
        else:
            self._close_session()
            self._failed = None
            self._session = session
            if opening.parameters is not None:
                session.use(*opening.parameters)
            facts = asdict(self._state()) | {"calibration_yaml": session.calibration_yaml}
            reply = Reply(number, value=facts)
        self._publish_state()
        self._send(reply)
        for skipped in () if session is None else session.skipped:
            self._send(SkippedFrameEvent(skipped.index, skipped.reason))

    def _abandon_opening(self) -> None:
        opening, self._opening = self._opening, None
        if opening is not None:
            opening.abandoned = True
            what = f"opening {opening.command.source} was given up, because it was closed meanwhile"
            self._send(Reply(opening.request.number, error=what, refusal="state"))

    def _close_session(self) -> None:
        session, self._session = self._session, None
        if session is not None:
            self._publisher.forget()
            self._explainer.forget()
            session.close()

    def _fail(self, doing: str, error: Exception) -> None:
        """The session cannot go on; the engine can."""
        if isinstance(error, DynamicObserverError):
            reason = f"{doing} failed: {error}"
        else:
            _log.error("%s failed", doing, exc_info=error)
            reason = f"{doing} failed: {_unexpected(error)}"
        self._failed = replace(self._state(), state=EngineState.FAILED, reason=reason)
        self._close_session()

    # --- observing -------------------------------------------------------------------------

    def _advance(self) -> None:
        """Read or observe at most one frame, whichever is due."""
        session = self._session
        if session is None or self._leaving:
            return
        source = session.source.info.spec
        try:
            skipped = session.player.read_ahead()
        except Exception as error:  # noqa: BLE001
            # A source is foreign code and foreign data; what it raises ends it, not the engine.
            self._fail(f"reading {source}", error)
            return
        if skipped is not None:
            self._send(SkippedFrameEvent(skipped.index, skipped.reason))
            return
        if session.player.wait_s(self._clock()) != 0.0:
            return
        try:
            self._observe(session)
        except Exception as error:  # noqa: BLE001
            # As above: a stage that breaks on this frame ends the session, not the engine.
            self._fail(f"observing a frame of {source}", error)

    def _observe(self, session: Session) -> None:
        now = self._clock()
        played = session.player.take(now)
        frame = self._raw_pair = played.frame
        observer = session.observer
        if played.new_segment:
            observer.begin_segment()
        trace = FullTrace()
        observation = observer.observe(frame, trace)
        published = self._clock()
        line = observation_line(observation)
        session.segment = session.first_segment + observation.segment
        line["segment"] = session.segment
        truth = session.truth
        self._send(
            ObservationEvent(
                sequence=self._sequence,
                line=line,
                truth=[] if truth is None else truth.match(observation, played.source_time),
                received=frame.received,
                published=published,
                frame_skips=session.player.skipped,
                run_id=session.run_id,
                ego_motion=ego_motion_facts(trace, observer.parameters),
            )
        )
        self._sequence += 1
        self.beat()
        observed = Observed(frame, observation, trace, observer.camera, observer.parameters)
        self._explainer.remember(observed, session.segment)
        self._publisher.publish(observed)

    # --- state -----------------------------------------------------------------------------

    def _state(self) -> StateEvent:
        session = self._session
        if session is None:
            return self._failed or StateEvent(EngineState.IDLE, None)
        running = session.run_id is not None
        return StateEvent(
            state=EngineState.RUNNING if running else EngineState.PREVIEW,
            reason=None,
            source=asdict(session.source.info),
            playback=session.playback_facts(self._clock()),
            camera=session.camera_facts(),
            run_id=session.run_id,
            segment=session.segment,
            has_truth=session.truth is not None,
        )

    def _publish_state(self) -> None:
        now = self._clock()
        state, sent = self._state(), self._sent_state
        # Where only the position moved, once in a while is enough.
        lately = now - self._state_sent_at < _POSITION_INTERVAL_S
        if sent is not None and (
            state == sent or (lately and _without_position(state) == _without_position(sent))
        ):
            return
        self._sent_state, self._state_sent_at = state, now
        self._send(state)


def _without_position(state: StateEvent) -> StateEvent:
    if state.playback is None:
        return state
    moving = ("frame", "achieved_rate")
    return replace(state, playback={k: v for k, v in state.playback.items() if k not in moving})


def _refusal(number: int, error: DynamicObserverError) -> Reply:
    if isinstance(error, NotNow):
        return Reply(number, error=str(error), refusal="state")
    if isinstance(error, InputError):
        return Reply(number, error=str(error), refusal="input")
    return Reply(number, error=str(error), refusal="failure")


def _unexpected(error: BaseException | None) -> str:
    return f"{type(error).__name__}: {error}"
