"""Main loop of the engine: commands, paced playback, observing, publishing, heartbeats.

One thread does all of it, so a heartbeat proves that this very loop is alive. Work that may take
long, such as opening a source or dense stereo for display, has threads of its own.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from dataclasses import replace

from app.contract.events import (
    HeartbeatEvent,
    ObservationEvent,
    SkippedFrameEvent,
    StateEvent,
    live_line,
)
from app.engine.calibrating import BoardPublisher, BoardSession
from app.engine.commands import CommandHandler
from app.engine.current_source import CurrentSource, Opening
from app.engine.drive_link import DriveLink
from app.engine.explaining import ego_motion_facts
from app.engine.live_truth import LiveTruth
from app.engine.observed import Observed
from app.engine.playback import PlayedFrame
from app.engine.played_source import PlayedSource, SourceOpener
from app.engine.preparing import Preparing
from app.engine.publishing import Publisher
from app.engine.session import ObserverFactory, Session
from app.runtime.requests import Request
from observer.guard.sight import REAL_WORLD, Sight
from observer.jsonl import ObservationLine, observation_line
from observer.occupancy import OccupancyMap
from observer.recording.payloads import LocalMapPayload
from observer.trace import FullTrace
from observer.truth.matching import TrueBodyEntry
from observer.types import Observation, StereoFrame

# Twice the promised rate, so that a small delay still keeps the promise.
BEAT_INTERVAL_S = 0.05
# Interval at which the page receives the playback position or a live source's figures on their own.
_POSITION_INTERVAL_S = 0.5
# Time for the truth threads to end. They need no orderly end: any left over end with the process.
_TRUTH_ENDS_S = 1.0


# Messages of the loop: requests, a finished opening, or None to leave.
Inbox = queue.SimpleQueue[Request | Opening | None]


class Engine:
    """Engine that answers commands and observes the open source until asked to stop."""

    def __init__(
        self,
        *,
        inbox: Inbox,
        send: Callable[[object], None],
        observations_lost: Callable[[], int],
        publisher: Publisher,
        drive: DriveLink | None = None,
        open_source: SourceOpener,
        make_observer: ObserverFactory,
        preparing: Preparing | None = None,
    ) -> None:
        """Set up the loop.

        Args:
            inbox: filled by the thread that receives requests; None in it ends the loop.
            send: takes replies and events and never blocks.
            observations_lost: returns how many events ``send`` has dropped.
            publisher: takes observed frames, for views and the cloud; closed at the end.
            drive: link to the drive process, if there is one.
            preparing: preparation that observers need; nothing is observed before it is done.
        """
        self._inbox = inbox
        self._send = send
        self._observations_lost = observations_lost
        self._publisher = publisher
        self._drive = drive
        self._thread = threading.get_ident()
        self._truth = LiveTruth()
        self._current = CurrentSource(
            open_source=open_source,
            make_observer=make_observer,
            opened=inbox.put,
            closed=publisher.forget,
            boards=BoardPublisher(send, publisher.show_cameras, self.beat),
            truth=self._truth,
            preparing=preparing,
            stage_clock=self._beating_clock,
        )
        self._commands = CommandHandler(
            self._current, publisher, self._truth, send=send, beat=self.beat
        )
        self._sequence = 0
        self._next_beat = 0.0
        self._sent_state: StateEvent | None = None
        self._state_sent_at = 0.0

    def run(self) -> None:
        """Run until ``Shutdown``, or None in the inbox; call it in the loop's own thread."""
        self._thread = threading.get_ident()
        self._publish_state()
        try:
            while not self._commands.leaving:
                self._take_messages()
                self._advance()
                self._publish_state()
        finally:
            self._truth.end()
            self._current.end()
            self._publisher.close()
            self._truth.join(_TRUTH_ENDS_S)

    def beat(self) -> None:
        """Send a heartbeat if one is due; only calls from the loop's own thread do anything."""
        now = time.monotonic()
        if now < self._next_beat or threading.get_ident() != self._thread:
            return
        self._next_beat = now + BEAT_INTERVAL_S
        self._send(HeartbeatEvent(now, {"observations_lost": self._observations_lost()}))

    def _beating_clock(self) -> float:
        # The observer reads its clock between stages, so heartbeats continue during a slow frame as
        # long as it makes progress; only a hung stage looks hung.
        self.beat()
        # Do not make the camera processes wait for the end of the frame either.
        session = self._current.session
        if session is not None and threading.get_ident() == self._thread:
            session.tend()
        return time.perf_counter()

    # --- waiting ---------------------------------------------------------------------------

    def _take_messages(self) -> None:
        """Wait until a frame is due or a message arrives; answer all messages."""
        while not self._commands.leaving:
            self.beat()
            now = time.monotonic()
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
                self._commands.leaving = True
            elif isinstance(message, Opening):
                self._opened(message)
            else:
                self._answer(message)

    def _due_in_s(self, now: float) -> float:
        session = self._current.session
        if session is None or session.resting:
            return float("inf")
        player = session.player
        if player.wants_reading:
            return 0.0
        wait = player.wait_s(now)
        return float("inf") if wait is None else wait

    def _answer(self, request: Request) -> None:
        reply = self._commands.answer(request)
        # Send the state first, so that it already matches when the requester gets the reply.
        self._publish_state()
        if reply is not None:
            self._send(reply)

    def _opened(self, opening: Opening) -> None:
        reply = self._current.finish(opening)
        self._publish_state()
        if reply is None:
            return
        self._send(reply)
        for skipped in () if opening.session is None else opening.session.skipped:
            self._send(SkippedFrameEvent(skipped.index, skipped.reason))

    # --- observing -------------------------------------------------------------------------

    def _advance(self) -> None:
        """Read or observe at most one frame, whichever is due."""
        session = self._current.session
        if session is None or session.resting or self._commands.leaving:
            return
        source = session.source.info.spec
        try:
            skipped = session.player.read_ahead()
        except Exception as error:  # noqa: BLE001
            # A source is third-party code and data: an exception in it ends the source, not the
            # engine.
            self._current.fail(f"reading {source}", error)
            return
        if skipped is not None:
            self._send(SkippedFrameEvent(skipped.index, skipped.reason))
            if isinstance(session, Session) and session.recorder is not None:
                session.recorder.skipped(skipped)
            return
        try:
            if isinstance(session, Session):
                session.prepare_truth(time.monotonic())
        except Exception as error:  # noqa: BLE001
            # As above.
            self._current.fail(f"computing the ground truth of {source}", error)
            return
        if session.player.wait_s(time.monotonic()) != 0.0:
            return
        try:
            self._use_frame(session)
        except Exception as error:  # noqa: BLE001
            # As above: a stage that fails on this frame ends the session, not the engine.
            self._current.fail(f"observing a frame of {source}", error)

    def _use_frame(self, session: PlayedSource) -> None:
        played = session.player.take(time.monotonic())
        self._current.raw_pair = played.frame
        if isinstance(session, Session):
            self._observe(session, played)
        elif isinstance(session, BoardSession):
            session.look(played.frame)

    def _observe(self, session: Session, played: PlayedFrame) -> None:
        """Observe a frame and pass the result on.

        The order is a safety property. A robot drives by the sight, so nothing comes before it but
        queueing the frame for the recording and observing it; what only people look at comes last.
        """
        began = time.monotonic()
        played = replace(played, frame=self._with_odometry(played.frame, session))
        observed = self._look_at(session, played)
        sight = self._tell_drive(session, observed)
        event, line = self._tell_web(session, played, observed)
        local_map = self._plan_the_way(session, sight)
        self._tell_local_map(session, played, observed.observation, local_map)
        self._record(session, played, event, line, local_map)
        self.beat()
        self._show(session, observed)
        session.spent(began, time.monotonic())

    def _look_at(self, session: Session, played: PlayedFrame) -> Observed:
        """Record the frame and observe it."""
        frame, observer = played.frame, session.observer
        if played.new_segment:
            observer.begin_segment()
        # Record before observing: it only queues, and a frame that breaks the observer is worth
        # keeping.
        if session.recorder is not None:
            session.recorder.frame(played)
        trace = FullTrace()
        observation = observer.observe(frame, trace)
        session.segment = session.first_segment + observation.segment
        return Observed(
            frame, observation, trace, observer.camera, observer.parameters, session.segment
        )

    def _tell_drive(self, session: Session, observed: Observed) -> Sight | None:
        """Write the sight that robots drive by, and return it; None if there are none."""
        if self._drive is None:
            return None
        guard = session.parameters.guard
        return self._drive.sight.write(observed, session.mount, session.world, guard)

    def _tell_web(
        self, session: Session, played: PlayedFrame, observed: Observed
    ) -> tuple[ObservationEvent, ObservationLine]:
        """Send the observation with its truth; return the event, and the line in full."""
        published = time.monotonic()
        frame, observation = observed.frame, observed.observation
        line = observation_line(observation)
        line["segment"] = session.segment
        event = ObservationEvent(
            sequence=self._sequence,
            line=live_line(line),
            truth=self._true_bodies(session, played, observation, line),
            received=frame.received,
            published=published,
            frame_skips=session.player.skipped,
            run_id=session.run_id,
            ego_motion=ego_motion_facts(observed.trace, observed.parameters),
            odometry=frame.odometry,
        )
        self._send(event)
        self._sequence += 1
        return event, line

    def _true_bodies(
        self,
        session: Session,
        played: PlayedFrame,
        observation: Observation,
        line: ObservationLine,
    ) -> list[TrueBodyEntry]:
        captured = self._truth.add_frame(observation, line, played.frame.received, session.recorder)
        # Motion capture replaces the truth of a simulation.
        if session.truth is None or self._truth.in_place:
            return captured
        return session.truth.match(observation, played.source_time)

    def _plan_the_way(self, session: Session, sight: Sight | None) -> OccupancyMap | None:
        """Plan the observer's path by its sight; return the local map if a new one is due."""
        if self._drive is None or sight is None:
            return None
        return self._drive.wayfinder.plan(sight, session.parameters)

    def _show(self, session: Session, observed: Observed) -> None:
        """Check the calibration's age and draw the views; failures are only reported."""
        session.ageing.add_frame(observed)
        # Without a run, the recorder only keeps the last half minute, without clouds.
        kept_by = None if session.run_id is None else session.recorder
        self._publisher.publish(observed, None if kept_by is None else kept_by.cloud)

    def _record(
        self,
        session: Session,
        played: PlayedFrame,
        event: ObservationEvent,
        line: ObservationLine,
        local_map: OccupancyMap | None,
    ) -> None:
        """Record the whole line of an observation, with the ground truth and map beside it."""
        recorder, frame = session.recorder, played.frame
        if recorder is None:
            return
        if session.truth is not None:
            sample = session.truth.sample(frame.index, frame.time, played.source_time)
            recorder.truth(sample, frame.received)
        recorder.observation(
            line, event.received, event.ego_motion, event.truth, self._truth.why_none
        )
        if local_map is not None:
            recorder.local_map(LocalMapPayload(frame=frame.index, time=frame.time, map=local_map))

    def _tell_local_map(
        self,
        session: Session,
        played: PlayedFrame,
        observation: Observation,
        made: OccupancyMap | None,
    ) -> None:
        event = session.local_maps.next_event(
            made,
            played.position,
            session.segment,
            played.frame.received,
            observation.T_world_camera,
        )
        if event is not None:
            self._send(event)

    def _with_odometry(self, frame: StereoFrame, session: Session) -> StereoFrame:
        """Return the frame with wheel odometry, for live cameras on a robot driven from here."""
        if self._drive is None or frame.odometry is not None or session.world != REAL_WORLD:
            return frame
        odometry = self._drive.wheels.odometry(frame.received)
        return frame if odometry is None else replace(frame, odometry=odometry)

    # --- state -----------------------------------------------------------------------------

    def _publish_state(self) -> None:
        now = time.monotonic()
        state, sent = self._state(), self._sent_state
        # If only frame-by-frame figures changed, an occasional update is enough.
        lately = now - self._state_sent_at < _POSITION_INTERVAL_S
        if sent is not None and (
            state == sent or (lately and _without_position(state) == _without_position(sent))
        ):
            return
        self._sent_state, self._state_sent_at = state, now
        self._send(state)

    def _state(self) -> StateEvent:
        state, missing = self._current.state(), self._publisher.troubles
        return replace(state, troubles=(*state.troubles, *missing)) if missing else state


def _without_position(state: StateEvent) -> StateEvent:
    """Return the state without the fields that change with every frame."""
    playback, live, recording, truth = state.playback, state.live, state.recording, state.truth
    return replace(
        state,
        playback=playback and replace(playback, frame=None, achieved_rate=None),
        live=live and replace(live, pairs=0, dropped=0, skew_median_s=None, skew_p95_s=None),
        ageing=None,
        recording=recording and replace(recording, bytes=0, seconds=0.0, dropped=0),
        truth=truth and replace(truth, bodies=(), clock=None, sentence="", alignment=None),
        troubles=(),
    )
