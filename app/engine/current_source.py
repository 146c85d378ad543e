"""State of the engine: the open source, the one being opened, or the reason for neither."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from app.contract.answers import Opened
from app.contract.commands import BeginCalibration, OpenSource
from app.contract.events import EngineState, StateEvent
from app.engine.calibrating import BoardPublisher, BoardSession, open_calibration
from app.engine.errors import NotNow, refusal, unexpected
from app.engine.live_truth import LiveTruth, ObservedSource
from app.engine.played_source import OpeningCommand, PlayedSource, SourceOpener
from app.engine.preparing import Preparing
from app.engine.recorders import Recorders
from app.engine.session import (
    FrameObserver,
    NotCalibrated,
    ObserverFactory,
    Session,
    open_session,
)
from app.runtime.heap import return_freed_memory
from app.runtime.requests import Reply, Request
from observer.errors import DynamicObserverError
from observer.navigation.parameters import AllParameters
from observer.opening import exclusive_world, live_devices, shown_spec
from observer.truth.live.opening import check_live
from observer.types import StereoFrame

_log = logging.getLogger(__name__)

# Requests are numbered from 1.
_NOBODYS = 0
# Seconds: an unfinished recording is readable too, so the wait for it may be short.
_RECORDING_ENDS_S = 2.0


class Opening:
    """Source that is being opened in its own thread: it may take long, or even hang.

    Attributes:
        request, command: the request that asked for it.
        session, error: the result; one of them is set once it is done.
        abandoned: it was cancelled; it must not record, and its session only needs to be closed.
        lender: the session that lent its source; it continues if the opening is refused.
        before: the session that had to be closed for it, to be reopened if the opening is refused.
        parameters: with their revision, if they were set meanwhile.
    """

    def __init__(self, request: Request, command: OpeningCommand) -> None:
        self.request = request
        self.command = command
        self.session: PlayedSource | None = None
        self.error: Exception | None = None
        self.abandoned = False
        self.lender: PlayedSource | None = None
        self.before: OpeningCommand | None = None
        self.parameters: tuple[AllParameters, int] | None = None

    def start(self, work: Callable[[], PlayedSource], done: Callable[[Opening], None]) -> None:
        """Start opening; ``done`` is called in the other thread when there is a result."""

        def run() -> None:
            try:
                self.session = work()
            except Exception as error:  # noqa: BLE001
                # Pass every exception to the loop, which tells refusals from faults.
                self.error = error
            done(self)

        threading.Thread(target=run, name="opening a source", daemon=True).start()

    def refuse_abandoned(self) -> None:
        """Refuse to go on with an opening that was cancelled; the opening thread calls this.

        Raises:
            NotNow: it was cancelled.
        """
        if self.abandoned:
            raise NotNow(f"opening {shown_spec(self.command.source)} was cancelled meanwhile")


class CurrentSource:
    """Current source: at most one open session and at most one source being opened.

    Attributes:
        session: the session being played.
        opening: the opening in progress.
        raw_pair: the newest unprocessed pair, for trying out a calibration.
    """

    def __init__(
        self,
        *,
        open_source: SourceOpener,
        make_observer: ObserverFactory,
        opened: Callable[[Opening], None],
        closed: Callable[[], None],
        boards: BoardPublisher,
        stage_clock: Callable[[], float],
        truth: LiveTruth | None = None,
        preparing: Preparing | None = None,
    ) -> None:
        """Set up with nothing open.

        Args:
            opened: called in another thread when ``opening`` is done; ``finish`` comes next.
            closed: called when a session is closed, before its source is.
            boards: receives the board detections and images while calibrating.
            stage_clock: clock for the observer's stage timings.
            truth: informed of what is observed and which motion capture to use.
            preparing: preparation that observers need; nothing is observed before it is done.
        """
        self._open_source = open_source
        self._make_observer = make_observer
        self._opened = opened
        self._closed = closed
        self._boards = boards
        self._truth = truth or LiveTruth()
        self._preparing = preparing
        self._stage_clock = stage_clock
        self._recorders = Recorders()
        self.session: PlayedSource | None = None
        self.opening: Opening | None = None
        self.raw_pair: StereoFrame | None = None
        self._failed: StateEvent | None = None
        # Number of the opening that led to the session.
        self._opened_as: int | None = None

    @property
    def observing(self) -> Session | None:
        """Return the observed session, if there is one."""
        return self.session if isinstance(self.session, Session) else None

    @property
    def calibrating(self) -> BoardSession | None:
        """Return the calibration session, if there is one."""
        return self.session if isinstance(self.session, BoardSession) else None

    def begin(self, request: Request, command: OpeningCommand) -> None:
        """Start opening in a separate thread; ``finish`` returns the reply to the request.

        Raises:
            NotNow: something else is being opened, or a run is going.
            TruthError: the spec of the live truth is invalid.
        """
        if self.opening is not None:
            raise NotNow(
                f"{shown_spec(self.opening.command.source)} is being opened; wait for it, or close "
                "the source"
            )
        if self.observing is not None and self.observing.run_id is not None:
            raise NotNow("a run is in progress; stop it before you open another source")
        if isinstance(command, OpenSource) and command.truth is not None:
            check_live(command.truth.spec)
        opening = self.opening = Opening(request, command)
        session, spec, open_source = self.session, command.source, self._open_source
        if session is not None and session.spec == spec and live_devices(spec):
            opening.lender, session.resting = session, True
            lent = session.lend()
            open_source = lambda _: lent  # noqa: E731
        elif session is not None and _exclude_each_other(session.spec, spec):
            opening.before = self._again(session)
            self.close()
        opening.start(lambda: self._open(opening, open_source), self._opened)

    def _again(self, session: PlayedSource) -> OpeningCommand:
        command = session.again()
        if isinstance(command, OpenSource):
            return replace(command, truth=self._truth.order)
        return command

    def _open(self, opening: Opening, open_source: SourceOpener) -> PlayedSource:
        command = opening.command
        if isinstance(command, BeginCalibration):
            return open_calibration(command, open_source, self._boards)
        return open_session(
            command,
            open_source,
            self._prepared_observer,
            self._stage_clock,
            self._recorders,
            opening.refuse_abandoned,
        )

    def _prepared_observer(self, *args: Any, **more: Any) -> FrameObserver:
        # Wait only now, so that the source opens while the preparation runs.
        if self._preparing is not None:
            self._preparing.wait()
        return self._make_observer(*args, **more)

    def finish(self, opening: Opening) -> Reply | None:
        """Observe the opened source, or return the refusal; None if the opening was given up."""
        session = opening.session
        if opening.abandoned:
            for left in (session, opening.lender):
                if left is not None:
                    left.close()
            return None
        self.opening = None
        if session is None:
            return self._not_opened(opening)
        if opening.lender is not None:
            session.take_over(opening.lender)
        self.close()
        self.session, self._opened_as = session, opening.command.opening
        calibration_yaml = None
        if isinstance(session, Session):
            assert isinstance(opening.command, OpenSource)
            self._truth.use(opening.command.truth)
            self._truth.observing(
                ObservedSource(session.source.info, session.mount, session.T_body_base)
            )
            if opening.parameters is not None:
                session.use(*opening.parameters)
            calibration_yaml = session.calibration_yaml
        return Reply(opening.request.number, value=Opened(self.state(), calibration_yaml))

    def _not_opened(self, opening: Opening) -> Reply:
        number, command, error = opening.request.number, opening.command, opening.error
        if isinstance(error, NotCalibrated) and error.pair is not None:
            self.raw_pair = error.pair
        if isinstance(error, DynamicObserverError):
            reply = refusal(number, error)
        else:
            source = shown_spec(command.source)
            _log.error("opening %s failed", source, exc_info=error)
            what = f"opening {source} failed: {unexpected(error)}"
            reply = Reply(number, error=what, refusal="failure")
        if opening.lender is not None:
            opening.lender.resting = False
        if opening.before is not None:
            # Nobody waits for this reply: its number belongs to no request.
            self.begin(Request(_NOBODYS, opening.before), opening.before)
        elif self.session is None:
            self._failed = StateEvent(EngineState.FAILED, reply.error)
            if isinstance(command, OpenSource):
                self._failed = replace(self._failed, run_id=command.run_id, segment=command.segment)
        return reply

    def cancel(self, number: int, reason: str) -> Reply | None:
        """Cancel the opening of this number, even if it has succeeded; leave any other alone.

        Args:
            reason: as for ``give_up_opening``.

        Returns:
            The refusal for its requester, if that still waits for a reply.
        """
        opening, session, given_up = self.opening, self.session, None
        if opening is not None and opening.command.opening == number:
            spec, given_up = opening.command.source, self.give_up_opening(reason)
        elif session is not None and self._opened_as == number:
            spec = session.spec
            self.close()
        else:
            return None
        if self.session is None:
            self._failed = StateEvent(EngineState.FAILED, _cancelled(spec, reason))
        return given_up

    def give_up_opening(self, reason: str) -> Reply | None:
        """Cancel the current opening, if any, and return the refusal for its requester.

        Args:
            reason: why, in words that follow "because".
        """
        opening, self.opening = self.opening, None
        if opening is None:
            return None
        opening.abandoned = True
        if opening.lender is not None:
            # The opening may still use the lent source: ``finish`` closes it.
            self.session = None
            self._truth.observing(None)
            self._closed()
        what = _cancelled(opening.command.source, reason)
        return Reply(opening.request.number, error=what, refusal="state")

    def close(self) -> None:
        """Close the session, if any; the state becomes idle."""
        session, self.session = self.session, None
        self._failed = None
        if session is not None:
            self._truth.observing(None)
            self._closed()
            session.close()
            del session
            return_freed_memory()

    def end(self) -> None:
        """Close the session permanently; wait for its recording, but not for long."""
        self.close()
        self._recorders.wait(_RECORDING_ENDS_S)

    def fail(self, doing: str, error: Exception) -> None:
        """End a session that cannot go on; the engine keeps running."""
        if isinstance(error, DynamicObserverError):
            reason = f"{doing} failed: {error}"
        else:
            _log.error("%s failed", doing, exc_info=error)
            reason = f"{doing} failed: {unexpected(error)}"
        failed = replace(self.state(), state=EngineState.FAILED, reason=reason)
        if self.observing is not None and self.observing.recorder is not None:
            self.observing.recorder.incident("failed", reason)
        self.close()
        self._failed = failed

    def state(self) -> StateEvent:
        """Return the engine's state as it is published."""
        truth = self._truth
        if self.session is None:
            idle = self._failed or StateEvent(EngineState.IDLE, None)
            note = None if self._preparing is None else self._preparing.note
            return replace(idle, truth=truth.facts(), preparing=note)
        state = self.session.state(time.monotonic())
        has_truth = state.has_truth or truth.in_place
        return replace(state, has_truth=has_truth, truth=truth.facts())


def _cancelled(spec: str, reason: str) -> str:
    return f"opening {shown_spec(spec)} was cancelled because {reason}"


def _exclude_each_other(a: str, b: str) -> bool:
    """Return true if the sources of both specs cannot be open together.

    A camera can be opened only once, by one program; two clients that step the same simulator would
    wait for each other.
    """
    world = exclusive_world(a)
    same_world = world is not None and world == exclusive_world(b)
    return same_world or not set(live_devices(a)).isdisjoint(live_devices(b))
