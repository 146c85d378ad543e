"""Observed session: one open source with its observer, truth and recording."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Protocol

from app.contract.commands import OpenSource
from app.contract.events import EngineState, StateEvent
from app.engine.ageing import CalibrationAgeing
from app.engine.playback import PlayedFrame, Player
from app.engine.played_source import PlayedSource
from app.engine.recording import RunRecorder
from observer.camera import StereoCamera
from observer.geometry import Pose
from observer.guard.parameters import AllParameters
from observer.guard.sight import REAL_WORLD
from observer.mount import CameraMount
from observer.opening import OpenedSource
from observer.parameters import Parameters
from observer.robots.contract import RobotPort
from observer.sources.contract import SkippedFrame
from observer.truth.matching import TruthMatcher
from observer.types import Observation, StereoFrame, Trace


class FrameObserver(Protocol):
    """Interface required of ``observer.observer.Observer``."""

    @property
    def camera(self) -> StereoCamera: ...

    @property
    def parameters(self) -> Parameters: ...

    def use(self, parameters: Parameters, revision: int) -> None: ...

    def begin_segment(self) -> None: ...

    def observe(self, frame: StereoFrame, trace: Trace = ...) -> Observation: ...


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
            parameters: the observer's and the guard's.
            calibration_yaml, mount: the calibration and mount the observer was made with.
            T_body_base: by body of motion capture, as the rig file gives it.
            ports: addresses of the robots in the source's world.
            begin_recording: begins to record a run as its command orders, or keeps what it can.
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
        self.run_id = command.run_id
        self.first_segment = command.segment
        self.parameters_revision = command.parameters_revision
        self.truth = None if opened.truth is None else TruthMatcher(opened.truth)
        self.segment = command.segment
        self._begin_recording = begin_recording
        self.recorder = begin_recording(command)
        if self.recorder is not None:
            self.recorder.parameters(parameters, command.parameters_revision)
            for frame in skipped:
                self.recorder.skipped(frame)

    def state(self, now: float) -> StateEvent:
        """Return the engine's state with this source, all but live motion capture."""
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
        )

    def again(self) -> OpenSource:
        """Return the command that would reopen it in its present state, with nothing kept."""
        return replace(
            self._command,
            parameters=dict(self.parameters.flat()),
            parameters_revision=self.parameters_revision,
            run_id=None,
            segment=0,
            record=None,
        )

    def use(self, parameters: AllParameters, revision: int) -> None:
        """Use these parameters from the next frame on; the guard's never reach the observer."""
        before, self.parameters = self.parameters, parameters
        if revision != self.parameters_revision:
            self.observer.use(parameters.vision, revision)
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
        """End the run and keep nothing from now on; the caller ends the returned recorder."""
        self.run_id = None
        recorder, self.recorder = self.recorder, self._begin_recording(self.again())
        if self.recorder is not None:
            self.recorder.parameters(self.parameters, self.parameters_revision)
        return recorder

    def close(self) -> None:
        if self.recorder is not None:
            self.recorder.end()
        super().close()

    @property
    def world(self) -> str | None:
        """Return the robots' own world, ``real`` for live cameras, none for a replay."""
        if self.opened.robots is not None:
            return self.opened.robots.world
        return REAL_WORLD if self.source.info.live else None
