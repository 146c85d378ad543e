"""Observed session: one open source with its observer, truth and recording, and its opening."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Protocol

from app.contract.commands import OpenSource
from app.contract.events import EngineState, StateEvent
from app.engine.ageing import CalibrationAgeing
from app.engine.local_maps import LocalMaps
from app.engine.playback import Player
from app.engine.played_source import (
    FIRST_PAIR_S,
    TRIES_FOR_A_PAIR,
    PlayedSource,
    SourceOpener,
    close_opened,
    read_first,
)
from app.engine.rate_governor import RateGovernor
from app.engine.recorders import Recorders
from app.engine.recording import RunRecorder
from observer.calibration.formats.opencv_file import (
    calibration_id,
    calibration_text,
    read_calibration,
)
from observer.camera import StereoCalibration, StereoCamera
from observer.errors import CalibrationError
from observer.geometry import Pose
from observer.guard.sight import REAL_WORLD
from observer.mount import CameraMount
from observer.navigation.parameters import AllParameters
from observer.opening import OpenedSource
from observer.parameters import Parameters
from observer.parameters.reductions import Reduction, reduced
from observer.rig.applied import mount_for
from observer.rig.rig_file import read_rig
from observer.robots.contract import RobotPort
from observer.sources.contract import SkippedFrame, Source
from observer.trace import Trace
from observer.truth.matching import TruthMatcher
from observer.types import Observation, StereoFrame

_log = logging.getLogger(__name__)


class FrameObserver(Protocol):
    """Interface required of ``observer.observer.Observer``."""

    @property
    def camera(self) -> StereoCamera: ...

    @property
    def parameters(self) -> Parameters: ...

    def use(self, parameters: Parameters, revision: int) -> None: ...

    def begin_segment(self) -> None: ...

    def observe(self, frame: StereoFrame, trace: Trace = ...) -> Observation: ...


class ObserverFactory(Protocol):
    """Factory of observers; ``mount`` is the source's own, ``clock`` serves the stage timings."""

    def __call__(
        self,
        calibration: StereoCalibration,
        parameters: Parameters,
        *,
        parameters_revision: int,
        mount: CameraMount | None,
        clock: Callable[[], float],
    ) -> FrameObserver: ...


class NotCalibrated(CalibrationError):
    """Source without a calibration: it brings none and none was given.

    Attributes:
        pair: a frame of the source for trying out a calibration; None if none is readable.
    """

    def __init__(self, message: str, pair: StereoFrame | None) -> None:
        self.pair = pair
        super().__init__(message)


class Session(PlayedSource):
    """State of one source that is observed."""

    def __init__(
        self,
        command: OpenSource,
        opened: OpenedSource,
        observer: FrameObserver,
        parameters: AllParameters,
        player: Player,
        skipped: tuple[SkippedFrame, ...],
        calibration_yaml: str,
        mount: CameraMount | None,
        T_body_base: Mapping[str, Pose],
        ports: tuple[RobotPort, ...],
        begin_recording: Callable[[OpenSource], RunRecorder | None],
    ) -> None:
        """Set up the session.

        Args:
            parameters: all parameters; the observer takes those of vision.
            calibration_yaml, mount: the calibration and mount the observer was made with.
            T_body_base: poses by motion capture body, as given in the rig file.
            ports: addresses of the robots in the source's world.
            begin_recording: begins the recording that a command orders; see ``Recorders.begin``.
        """
        super().__init__(command.source, opened, player, skipped)
        self._command = command
        self.calibration_yaml = calibration_yaml
        self.mount = mount
        self.T_body_base = T_body_base
        self._ports = ports
        self.ageing = CalibrationAgeing(observer.camera, mount)
        self.observer = observer
        self.parameters = parameters
        self._in_force = parameters
        # A recording or scenario drops no frame, however slow processing is.
        self._governor = RateGovernor() if self.source.info.live else None
        self.run_id = command.run_id
        self.first_segment = command.segment
        self.parameters_revision = command.parameters_revision
        self.local_maps = LocalMaps(opened.local_maps, mount)
        self.truth = None if opened.truth is None else TruthMatcher(opened.truth)
        self.segment = command.segment
        self._begin_recording = begin_recording
        self.recorder = begin_recording(command)
        if self.recorder is not None:
            self.recorder.parameters(parameters, command.parameters_revision)
            for frame in skipped:
                self.recorder.skipped(frame)

    def state(self, now: float) -> StateEvent:
        """Return the engine's state with this source, without live motion capture."""
        recorder = None if self.run_id is None else self.recorder
        return replace(
            super().state(now),
            state=EngineState.PREVIEW if self.run_id is None else EngineState.RUNNING,
            camera=self.observer.camera,
            run_id=self.run_id,
            segment=self.segment,
            has_truth=self.truth is not None,
            mount=self.mount,
            ageing=self.ageing.facts(),
            world=self.world,
            robots=self._ports,
            recording=None if recorder is None else recorder.facts(),
            calibration_notes=()
            if self._command.calibration_yaml is not None
            else _notes(self.opened),
            truth_note=self.opened.truth_note,
            troubles=self.ageing.troubles,
        )

    def again(self) -> OpenSource:
        """Return the command that would reopen it in its present state, without a run."""
        return replace(
            self._command,
            parameters=dict(self.parameters.flat()),
            parameters_revision=self.parameters_revision,
            run_id=None,
            segment=0,
            record=None,
        )

    def use(self, parameters: AllParameters, revision: int) -> None:
        """Use these parameters from the next frame on; only those of vision reach the observer."""
        self.parameters = parameters
        self._apply(revision)

    def prepare_truth(self, now: float) -> None:
        """Compute the truth of the frame that waits for its turn, if it waits for long enough.

        A simulator casts rays for it, which would delay the observation on its way to the page.
        A frame that is late must not wait for it either: that is observed first.

        Args:
            now: host's monotonic clock, seconds.
        """
        source_time = self.player.held_source_time
        if self.truth is None or source_time is None:
            return
        wait = self.player.wait_s(now)
        if wait is None or wait > self.truth.took_s:
            self.truth.prepare(source_time)

    def spent(self, began: float, ended: float) -> None:
        """Record the time spent on a frame; this may change how a live source is processed.

        Args:
            began, ended: host's monotonic clock, seconds.
        """
        model = self.parameters.ego_motion.model
        if self._governor is None or not self._governor.spent(began, ended, model):
            return
        self._apply(self.parameters_revision)
        note = "full processing again: the computer keeps up with the cameras"
        if self.reduced_to is not None:
            note = f"the computer is too slow for full processing: reduced to {self.reduced_to}"
        _log.warning("%s", note)
        if self.recorder is not None:
            self.recorder.incident("processing", note)

    @property
    def reduced_to(self) -> str | None:
        """Describe in words what reduced processing still does; None for full processing."""
        return None if self._reduction is None else self._reduction.words

    @property
    def _reduction(self) -> Reduction | None:
        if self._governor is None:
            return None
        return self._governor.reduction(self.parameters.ego_motion.model)

    def _apply(self, revision: int) -> None:
        before = self._in_force
        self._in_force = now = reduced(self.parameters, self._reduction)
        if revision != self.parameters_revision or now.vision != before.vision:
            self.observer.use(now.vision, revision)
        if self.recorder is not None:
            next_index = self.player.next_index
            self.recorder.parameters(now, revision, before=before, frame=next_index)
        self.parameters_revision = revision

    def end_run(self) -> RunRecorder | None:
        """End the run; the caller ends the returned recorder."""
        self.run_id = None
        recorder, self.recorder = self.recorder, self._begin_recording(self.again())
        if self.recorder is not None:
            self.recorder.parameters(self._in_force, self.parameters_revision)
        return recorder

    def close(self) -> None:
        if self.recorder is not None:
            self.recorder.end()
        super().close()

    @property
    def world(self) -> str | None:
        """Return the robots' own world, ``real`` for live cameras, or None for a replay."""
        if self.opened.robots is not None:
            return self.opened.robots.world
        return REAL_WORLD if self.source.info.live else None


def open_session(
    command: OpenSource,
    open_source: SourceOpener,
    make_observer: ObserverFactory,
    clock: Callable[[], float],
    recorders: Recorders,
    refuse_abandoned: Callable[[], None],
) -> Session:
    """Open the source and all that belongs to it, and read its first frame.

    If refused, nothing stays open.

    Args:
        refuse_abandoned: raises if nobody wants the session any longer: its run may be deleted, and
            a recording begun for it would stay forever.

    Raises:
        InputError: the source, the calibration or a parameter cannot be used; one sentence says
            why.
        RecordingError: a recording was ordered and is not possible.
    """
    parameters = AllParameters().changed(command.parameters)
    given = (
        None
        if command.calibration_yaml is None
        else read_calibration(command.calibration_yaml, name="the given calibration")
    )
    rig = None if command.rig_yaml is None else read_rig(command.rig_yaml, "the rig")
    opened = open_source(command.source)
    try:
        calibration = _calibration(given, opened.source)
        if given is None:
            for note in _notes(opened):
                _log.warning("%s", note)
        # A given text is passed on unchanged, so that it keeps its content hash.
        text = command.calibration_yaml or calibration_text(calibration)
        bodies = {} if rig is None else rig.T_body_base
        mount = mount_for(opened.source.info, rig, calibration_id(text))
        observer = make_observer(
            calibration,
            parameters.vision,
            parameters_revision=command.parameters_revision,
            mount=mount,
            clock=clock,
        )
        # Attach the robots before the first frame is read: that read takes a second or two, and
        # attaching them later would make it necessary again.
        ports = () if opened.robots is None else opened.robots.serve()
        player = Player(opened.source, paused=command.paused, rate=command.rate, loop=command.loop)
        skipped = read_first(player)
        info = opened.source.info
        begin = partial(recorders.begin, info=info, calibration_yaml=text, mount=mount)
        refuse_abandoned()
        return Session(
            command,
            opened,
            observer,
            parameters,
            player,
            skipped,
            text,
            mount,
            bodies,
            ports,
            begin,
        )
    except BaseException:
        close_opened(opened)
        raise


def _notes(opened: OpenedSource) -> tuple[str, ...]:
    """Return notes for the user on decisions made while reading the source's own calibration."""
    spec = opened.source.info.spec
    return tuple(f"calibration of {spec}: {note}" for note in opened.calibration_notes)


def _calibration(given: StereoCalibration | None, source: Source) -> StereoCalibration:
    """Return the given calibration, or else the source's own.

    Raises:
        NotCalibrated: there is neither.
        CalibrationError: the calibration is for images of another size.
    """
    calibration, info = given or source.calibration, source.info
    if calibration is None:
        raise NotCalibrated(
            f"{info.spec} has no calibration; calibrate it under Calibration, choose a "
            "calibration for it, or put a calibration.yaml into its folder",
            _first_pair(source),
        )
    if (calibration.width, calibration.height) != (info.width, info.height):
        raise CalibrationError(
            f"the calibration is for {calibration.width}x{calibration.height} images, but "
            f"{info.spec} delivers {info.width}x{info.height}; choose a calibration made at this "
            "image size"
        )
    return calibration


def _first_pair(source: Source) -> StereoFrame | None:
    until = time.monotonic() + FIRST_PAIR_S
    skipped = 0
    while skipped < TRIES_FOR_A_PAIR and time.monotonic() < until:
        item = source.read()
        if isinstance(item, StereoFrame):
            return item
        if item is None:
            return None
        skipped += isinstance(item, SkippedFrame)
    return None
