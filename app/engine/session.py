"""One open source: played, and observed with its observer and truth."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from functools import partial
from typing import Any, Protocol

from app.engine.ageing import CalibrationAgeing
from app.engine.playback import PlayedFrame, Player
from app.engine.recorders import Recorders
from app.engine.recording import RunRecorder
from app.engine.truth_matching import TruthMatcher
from app.messages import BeginCalibration, EngineState, OpenSource
from observer.calibration.formats.opencv_file import (
    calibration_id,
    calibration_text,
    read_calibration,
)
from observer.camera import StereoCalibration, StereoCamera
from observer.errors import CalibrationError
from observer.guard.sight import REAL_WORLD
from observer.mount import CameraMount
from observer.opening import OpenedSource
from observer.parameters import Parameters
from observer.rig.applied import mount_for
from observer.rig.rig_file import read_rig
from observer.robots.contract import RobotPort, RobotWorld
from observer.sources.contract import LiveSource, SkippedFrame, Source
from observer.types import Observation, StereoFrame, Trace

# How many unreadable frames are passed over while opening to find the first readable one.
_TRIES_FOR_A_PAIR = 20
# A live source has delivered before it counts as open; the next pair is not far.
_FIRST_PAIR_S = 2.0


class FrameObserver(Protocol):
    """What the engine needs of ``observer.observer.Observer``."""

    @property
    def camera(self) -> StereoCamera: ...

    @property
    def parameters(self) -> Parameters: ...

    def use(self, parameters: Parameters, revision: int) -> None: ...

    def begin_segment(self) -> None: ...

    def observe(self, frame: StereoFrame, trace: Trace = ...) -> Observation: ...


class ObserverFactory(Protocol):
    """Makes an observer; ``mount`` is the source's own, ``clock`` serves its stage timings."""

    def __call__(
        self,
        calibration: StereoCalibration,
        parameters: Parameters,
        *,
        parameters_revision: int,
        mount: CameraMount | None,
        clock: Callable[[], float],
    ) -> FrameObserver: ...


# What opens a source.
OpeningCommand = OpenSource | BeginCalibration
SourceOpener = Callable[[str], OpenedSource]


class NotCalibrated(CalibrationError):
    """The source brings no calibration and none was given.

    Attributes:
        pair: a frame of the source, with which a calibration can be tried out; None where it
            has no readable one.
    """

    def __init__(self, message: str, pair: StereoFrame | None) -> None:
        self.pair = pair
        super().__init__(message)


class PlayedSource:
    """A source and its player. Used by one thread at a time.

    Attributes:
        spec: the text it was opened by, passwords included.
        resting: whether it is not read, because its source is being handed on.
        skipped: frames that could not be read while opening, before the first one.
        robots: of the source's own world; reached while it is observed.
        run_id, segment: of what is kept; None and 0 where nothing is.
        has_truth: whether truth belongs to the source.
    """

    def __init__(
        self,
        spec: str,
        source: Source,
        player: Player,
        skipped: tuple[SkippedFrame, ...],
        robots: RobotWorld | None = None,
    ) -> None:
        self.spec = spec
        self.resting = False
        self.source = source
        self.robots = robots
        self._live = source if isinstance(source, LiveSource) else None
        self.player = player
        self.skipped = skipped
        self.run_id: str | None = None
        self.segment = 0
        self.has_truth = False

    @property
    def state(self) -> EngineState:
        """What the engine does with this source."""
        return EngineState.PREVIEW

    def camera_facts(self) -> dict[str, Any] | None:
        """The rectified camera as ``StateEvent.camera`` holds it."""
        return None

    def mount_facts(self) -> dict[str, Any] | None:
        """As ``StateEvent.mount`` holds it."""
        return None

    def ageing_facts(self) -> dict[str, Any] | None:
        """As ``StateEvent.ageing`` holds it."""
        return None

    def recording_facts(self) -> dict[str, Any] | None:
        """As ``StateEvent.recording`` holds it."""
        return None

    @property
    def world(self) -> str | None:
        """As ``StateEvent.world`` holds it."""
        return None

    def robot_facts(self) -> tuple[dict[str, Any], ...]:
        """As ``StateEvent.robots`` holds it."""
        return ()

    def playback_facts(self, now: float) -> dict[str, Any]:
        """As ``StateEvent.playback`` holds it."""
        player = self.player
        achieved = player.achieved_rate(now)
        return {
            "paused": player.paused,
            "rate": player.rate,
            "loop": player.loop,
            "frame": player.position,
            "frame_count": self.source.info.frame_count,
            "ended": player.ended,
            "seekable": player.seekable,
            "achieved_rate": None if achieved is None else round(achieved, 2),
        }

    def tend(self) -> None:
        """Let a live source decode ahead; for the thread that reads, between two reads."""
        if self._live is not None:
            self._live.tend()

    def live_facts(self) -> dict[str, Any] | None:
        """As ``StateEvent.live`` holds it."""
        if self._live is None:
            return None
        return {**asdict(self._live.report()), "trouble": self.player.trouble}

    def again(self) -> OpeningCommand:
        """What would open it anew as it is now."""
        raise NotImplementedError

    def close(self) -> None:
        """Let go of the source and the robots of its world."""
        if self.robots is not None:
            self.robots.close()
        self.source.close()


class Session(PlayedSource):
    """What belongs to one source that is observed."""

    def __init__(
        self,
        command: OpenSource,
        opened: OpenedSource,
        observer: FrameObserver,
        player: Player,
        skipped: tuple[SkippedFrame, ...],
        calibration_yaml: str,
        mount: CameraMount | None,
        ports: tuple[RobotPort, ...],
        recorder: RunRecorder | None = None,
        record_again: Callable[[], RunRecorder | None] = lambda: None,
    ) -> None:
        """
        Args:
            calibration_yaml, mount: what the observer was made with.
            ports: where the robots of the source's world are reached.
            recorder: records the run, where it is to be recorded. record_again: makes the one
                behind the run.
        """
        super().__init__(command.source, opened.source, player, skipped, opened.robots)
        self._command = command
        self.calibration_yaml = calibration_yaml
        self.mount = mount
        self._ports = ports
        self.ageing = CalibrationAgeing(observer.camera, mount)
        self.observer = observer
        self.run_id = command.run_id
        self.first_segment = command.segment
        self.parameters_revision = command.parameters_revision
        self.truth = None if opened.truth is None else TruthMatcher(opened.truth)
        self.has_truth = self.truth is not None
        self.segment = command.segment
        self.recorder = recorder
        self._record_again = record_again
        if recorder is not None:
            recorder.parameters(observer.parameters, command.parameters_revision)
            for frame in skipped:
                recorder.skipped(frame)

    @property
    def state(self) -> EngineState:
        return EngineState.PREVIEW if self.run_id is None else EngineState.RUNNING

    def again(self) -> OpenSource:
        """What would open it anew as it is now, with nothing kept."""
        return replace(
            self._command,
            parameters=dict(self.observer.parameters.flat()),
            parameters_revision=self.parameters_revision,
            run_id=None,
            segment=0,
            record=None,
        )

    def use(self, parameters: Parameters, revision: int) -> None:
        """Observe with these parameters from the next frame on."""
        before = self.observer.parameters
        self.observer.use(parameters, revision)
        if self.recorder is not None:
            next_index = self.player.next_index
            self.recorder.parameters(parameters, revision, before=before, frame=next_index)
        self.parameters_revision = revision

    def record(self, frame: StereoFrame, played: PlayedFrame) -> None:
        """Record a frame that is about to be observed, where the run is recorded."""
        if self.recorder is not None:
            self.recorder.frame(
                frame,
                position=played.position,
                source_time=played.source_time,
                begins="segment" if played.new_segment else None,
            )

    def end_run(self) -> RunRecorder | None:
        """Keep nothing from now on; whoever asked ends what is returned."""
        self.run_id = None
        recorder = self.stop_recording()
        self.recorder = self._record_again()
        if self.recorder is not None:
            self.recorder.parameters(self.observer.parameters, self.parameters_revision)
        return recorder

    def stop_recording(self) -> RunRecorder | None:
        """Nothing more is recorded; whoever asked ends what is returned."""
        recorder, self.recorder = self.recorder, None
        return recorder

    def recording_facts(self) -> dict[str, Any] | None:
        """As ``StateEvent.recording`` holds it."""
        if self.run_id is None or self.recorder is None:
            return None
        return self.recorder.facts()

    def close(self) -> None:
        recorder = self.stop_recording()
        if recorder is not None:
            recorder.end()
        super().close()

    def camera_facts(self) -> dict[str, Any]:
        """The rectified camera as ``StateEvent.camera`` holds it."""
        return asdict(self.observer.camera)

    def mount_facts(self) -> dict[str, Any] | None:
        """As ``StateEvent.mount`` holds it."""
        return None if self.mount is None else asdict(self.mount)

    def ageing_facts(self) -> dict[str, Any] | None:
        """As ``StateEvent.ageing`` holds it."""
        return self.ageing.facts()

    @property
    def world(self) -> str | None:
        """The robots' own, ``real`` of live cameras, none of what is only replayed."""
        if self.robots is not None:
            return self.robots.world
        return REAL_WORLD if self.source.info.live else None

    def robot_facts(self) -> tuple[dict[str, Any], ...]:
        """As ``StateEvent.robots`` holds it."""
        return tuple(asdict(port) for port in self._ports)


def open_session(
    command: OpenSource,
    open_source: SourceOpener,
    make_observer: ObserverFactory,
    clock: Callable[[], float],
    recorders: Recorders,
) -> Session:
    """Open the source and all that belongs to it, its first frame already read; on any refusal
    nothing stays open.

    Raises:
        InputError: one sentence of what is wrong with the source, calibration or a parameter.
        RecordingError: it was to be recorded and cannot be.
    """
    parameters = parse_parameters(command.parameters)
    calibration = (
        None
        if command.calibration_yaml is None
        else read_calibration(command.calibration_yaml, name="the given calibration")
    )
    rig = None if command.rig_yaml is None else read_rig(command.rig_yaml, "the rig")
    opened = open_source(command.source)
    try:
        calibration = calibration or opened.source.calibration
        if calibration is None:
            raise NotCalibrated(
                f"{opened.source.info.spec} brings no calibration; calibrate it under "
                f"Calibration, choose a calibration for it, or put a calibration.yaml into its "
                f"folder",
                _first_pair(opened.source),
            )
        _check_size(calibration, opened.source)
        # A given text is handed back as it was given, so that it keeps its content hash.
        text = command.calibration_yaml or calibration_text(calibration)
        mount = mount_for(opened.source.info, rig, calibration_id(text))
        observer = make_observer(
            calibration,
            parameters,
            parameters_revision=command.parameters_revision,
            mount=mount,
            clock=clock,
        )
        # Before the first frame: it takes a second or two, and again once robots follow it.
        ports = () if opened.robots is None else opened.robots.serve()
        player = Player(opened.source, paused=command.paused, rate=command.rate, loop=command.loop)
        skipped = read_first(player)
        info = opened.source.info
        begin = partial(recorders.begin, info=info, calibration_yaml=text, mount=mount)
        recorder = begin(command)
        again = partial(begin, replace(command, run_id=None, segment=0, record=None))
        return Session(
            command, opened, observer, player, skipped, text, mount, ports, recorder, again
        )
    except BaseException:
        close_opened(opened)
        raise


def close_opened(opened: OpenedSource) -> None:
    """Let go of what was opened and will not be played."""
    if opened.robots is not None:
        opened.robots.close()
    opened.source.close()


def parse_parameters(values: Mapping[str, Any]) -> Parameters:
    """The declared defaults with these values, by dotted name.

    Raises:
        ParameterError: naming every refused field and its range.
    """
    return Parameters().changed(values)


def read_first(player: Player) -> tuple[SkippedFrame, ...]:
    """Have the first frame at hand: some sources do their heavy work at it, which would stop the
    engine's heart.

    Returns:
        The frames that could not be read before it.
    """
    skipped: list[SkippedFrame] = []
    until = time.monotonic() + _FIRST_PAIR_S
    while player.wants_reading and len(skipped) < _TRIES_FOR_A_PAIR and time.monotonic() < until:
        frame = player.read_ahead()
        if frame is not None:
            skipped.append(frame)
    return tuple(skipped)


def _check_size(calibration: StereoCalibration, source: Source) -> None:
    info = source.info
    if (calibration.width, calibration.height) != (info.width, info.height):
        raise CalibrationError(
            f"the calibration is for images of {calibration.width}x{calibration.height} pixels, "
            f"but {info.spec} delivers {info.width}x{info.height}; choose the calibration that "
            f"was made with these images"
        )


def _first_pair(source: Source) -> StereoFrame | None:
    until = time.monotonic() + _FIRST_PAIR_S
    skipped = 0
    while skipped < _TRIES_FOR_A_PAIR and time.monotonic() < until:
        item = source.read()
        if isinstance(item, StereoFrame):
            return item
        if item is None:
            return None
        skipped += isinstance(item, SkippedFrame)
    return None
