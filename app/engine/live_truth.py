"""Live motion capture beside the observations: for display and recording, never for the method.

The loop only reads what the threads here have left for it: whatever happens to motion capture,
frames are observed and robots driven as they would be without it.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from app.contract.commands import LiveTruthOrder
from app.contract.live_truth import LiveTruthStatus
from app.engine.aligning import Aligned, AlignmentThread
from app.engine.errors import unexpected
from app.engine.motion_listening import MotionListener
from app.engine.recording import RunRecorder
from app.engine.truth_facts import truth_facts
from app.workers.alignment.messages import Choices
from observer.geometry import Pose
from observer.jsonl import ObservationLine
from observer.mount import CameraMount
from observer.sources.contract import SIMULATED_KINDS, SourceInfo
from observer.truth.alignment.newest import NewestTruth
from observer.truth.live.contract import LiveCaptureReport
from observer.truth.live.opening import check_live
from observer.truth.matching import TrueBodyEntry, assign, entry
from observer.types import Observation

_log = logging.getLogger(__name__)

# First frames of a new segment, used to place its world in the room.
_FIRST_FRAMES = 20


@dataclass(frozen=True, eq=False)
class ObservedSource:
    """Source under observation.

    Attributes:
        info: of the source.
        mount: of its camera.
        T_body_base: by body, as the rig file gives it.
    """

    info: SourceInfo
    mount: CameraMount | None
    T_body_base: Mapping[str, Pose] = field(default_factory=dict)

    @property
    def now(self) -> bool:
        """Return true if the source shows the present, as motion capture does."""
        # A simulation runs by the wall clock; any other source that is not live was recorded.
        return self.info.live or self.info.kind in SIMULATED_KINDS


@dataclass(frozen=True, eq=False)
class _Listening:
    """State of one connection."""

    listener: MotionListener
    aligner: AlignmentThread
    newest: NewestTruth = field(default_factory=NewestTruth)


def _aligner(listener: MotionListener) -> AlignmentThread:
    return AlignmentThread(listener.for_alignment, lambda: listener.report.clock)


class LiveTruth:
    """Live truth of the observed source. It belongs to the loop's thread; no call blocks.

    Attributes:
        order: motion capture to listen to, as ordered; None if none was.
    """

    def __init__(
        self,
        make_listener: Callable[[str], MotionListener] = MotionListener,
        make_aligner: Callable[[MotionListener], AlignmentThread] = _aligner,
    ) -> None:
        self.order: LiveTruthOrder | None = None
        self._make_listener = make_listener
        self._make_aligner = make_aligner
        self._listening: _Listening | None = None
        self._ending: list[MotionListener | AlignmentThread] = []
        self._source: ObservedSource | None = None
        self._last: SourceInfo | None = None
        self._session = 0
        # By segment: worlds placed by the observer's own pose before the alignment covers them.
        self._placed: dict[int, Pose] = {}
        self._first: deque[tuple[int, float, Pose]] = deque(maxlen=_FIRST_FRAMES)
        self._broken: str | None = None
        self._inputs: tuple[object, ...] = ()
        self._facts: LiveTruthStatus | None = None

    def use(self, order: LiveTruthOrder | None) -> None:
        """Listen as ordered from now on; keep an open connection to the same motion capture.

        Raises:
            TruthError: the spec names no live motion capture; nothing was changed.
        """
        if order == self.order:
            return
        if order is not None:
            check_live(order.spec)
        before = self._listening
        if before is not None and (order is None or order.spec != before.listener.spec):
            self._ending = [thread for thread in self._ending if thread.is_alive()]
            self._ending += [before.listener, before.aligner]
            before.listener.end()
            before.aligner.end()
            self._listening = None
        if order is not None and self._listening is None:
            listener = self._make_listener(order.spec)
            self._listening = _Listening(listener, self._make_aligner(listener))
        self.order = order
        self._begin(carry=False)

    @property
    def in_place(self) -> bool:
        """Return true if motion capture replaces the source's own truth."""
        return self.order is not None and self._source is not None and self._source.now

    @property
    def why_none(self) -> str | None:
        """Return why there is no truth yet; None if there is, or if none is expected."""
        facts = self.facts() if self.in_place else None
        return None if facts is None or facts.aligned else facts.sentence

    def observing(self, source: ObservedSource | None) -> None:
        """Begin a new world for the newly observed source; None if nothing is observed."""
        self._source = source
        # While a source is being reopened, nothing is observed for a moment.
        self._begin(carry=source is None or source.info == self._last)
        if source is not None:
            self._last = source.info

    def add_frame(
        self,
        observation: Observation,
        line: ObservationLine,
        received: float,
        recorder: RunRecorder | None,
    ) -> list[TrueBodyEntry]:
        """Return the entries of ``ObservationEvent.truth`` for an observed frame.

        Args:
            line: JSON line of the frame.
            received: reception of the frame on the host's monotonic clock.
            recorder: recorder of the run; receives all motion capture samples from now on.
        """
        listening = self._listening
        if listening is None:
            return []
        listening.listener.recorder = recorder
        try:
            return self._look(listening, observation, line, received)
        except Exception as error:  # noqa: BLE001
            # Truth is for display only: it must never end the loop that drives the robots.
            if self._broken is None:
                _log.exception("processing live motion capture failed")
            self._broken = f"comparison with motion capture failed: {unexpected(error)}"
            return []

    def facts(self) -> LiveTruthStatus | None:
        """Return the facts as ``StateEvent.truth`` holds them."""
        order, listening = self.order, self._listening
        if order is None or listening is None:
            return None
        report, trouble = listening.listener.report, listening.listener.trouble
        aligned, sentence = self._aligned(listening), listening.aligner.sentence
        inputs = (order, report, trouble, aligned, sentence, self._source, self._broken)
        # Called with every frame and beat, but rebuilt only after a change.
        if len(inputs) != len(self._inputs) or any(
            a is not b for a, b in zip(inputs, self._inputs, strict=True)
        ):
            self._inputs = inputs
            self._facts = truth_facts(
                order,
                report,
                trouble or self._broken,
                aligned,
                self._why_not(report, trouble) or sentence,
            )
        return self._facts

    def end(self) -> None:
        """Stop listening; returns at once."""
        self.use(None)

    def join(self, timeout_s: float) -> None:
        """Wait for the threads of all ended connections."""
        for thread in self._ending:
            thread.join(timeout_s)

    # -----------------------------------------------------------------------------------------

    def _begin(self, *, carry: bool) -> None:
        self._session += 1
        self._placed.clear()
        self._first.clear()
        self._broken = None
        listening, source, order = self._listening, self._source, self.order
        if listening is None or order is None:
            return
        listening.listener.recorder = None
        T_body_base, mount = None, None
        if source is not None:
            mount = source.mount
            T_body_base = source.T_body_base.get(order.observer or "")
        choices = Choices(order.observer, order.ignore, mount, T_body_base)
        listening.aligner.begin(self._session, choices, carry=carry)

    def _look(
        self,
        listening: _Listening,
        observation: Observation,
        line: ObservationLine,
        received: float,
    ) -> list[TrueBodyEntry]:
        newest = listening.newest
        newest.add(listening.listener.for_frames())
        if not self.in_place:
            return []
        listening.aligner.observed(line, received)
        segment, time = line["segment"], observation.time
        if observation.T_world_camera is not None:
            self._first.append((segment, time, observation.T_world_camera))
        aligned = self._aligned(listening)
        if aligned is None:
            return []
        T_world_room = self._room(aligned, newest, segment)
        if T_world_room is None:
            return []
        found = newest.bodies(aligned.alignment, aligned.clocks, T_world_room, time)
        obstacles = [each.body for each in found if each.body.role == "obstacle"]
        positions = {obstacle.id: obstacle.position for obstacle in observation.reported}
        tracks = assign(obstacles, Pose.identity(), positions)
        return [
            {**entry(each.body, Pose.identity(), tracks.get(each.body.id)), "time": each.time}
            for each in found
        ]

    def _aligned(self, listening: _Listening) -> Aligned | None:
        aligned = listening.aligner.aligned
        return aligned if aligned is not None and aligned.session == self._session else None

    def _room(self, aligned: Aligned, newest: NewestTruth, segment: int) -> Pose | None:
        """Return ``T_world_room``, from the alignment or from the observer's captured pose."""
        known = aligned.alignment.T_world_room.get(segment, self._placed.get(segment))
        if known is not None:
            return known
        for of, time, T_world_camera in self._first:
            if of != segment:
                continue
            T_room_camera = newest.room_camera(aligned.alignment, aligned.clocks, time)
            if T_room_camera is not None:
                self._placed[segment] = T_world_camera @ T_room_camera.inverse()
                return self._placed[segment]
        return None

    def _why_not(self, report: LiveCaptureReport, trouble: str | None) -> str | None:
        """Return why no alignment is possible now, for reasons outside the alignment thread."""
        source = self._source
        if source is None:
            return "not aligned yet: no source is open"
        if not source.now:
            return (
                f"not aligned: {source.info.spec} is a recording, but live motion capture shows "
                "the present; align its run with a ground-truth file instead"
            )
        if report.state != "receiving":
            what = trouble or report.trouble or "connecting to motion capture"
            return f"not aligned yet: {what}"
        return None
