"""Effects of the commands, independent of when the loop handles them."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from app.contract.answers import CalibrationPreview, KeptClip, ScenePairs
from app.contract.commands import (
    BeginCalibration,
    CancelOpening,
    ChangeCalibration,
    CloseSource,
    ExplainPixel,
    LookAtFloor,
    MeasureDepth,
    OpenSource,
    PreviewCalibration,
    RecordRobots,
    SaveClip,
    SetParameters,
    SetPlayback,
    SetTruth,
    Shutdown,
    StopRun,
    TakeScenePairs,
    WatchViews,
)
from app.contract.status import PlaybackStatus
from app.engine.calibration_preview import preview_calibration
from app.engine.current_source import CurrentSource
from app.engine.depth_measuring import measure_depth
from app.engine.errors import NotNow, refusal, unexpected
from app.engine.explaining import explain
from app.engine.floor_looking import look_at_floor
from app.engine.live_truth import LiveTruth
from app.engine.publishing import Publisher
from app.runtime.requests import Reply, Request
from observer.errors import DynamicObserverError, InputError
from observer.navigation.parameters import AllParameters
from observer.recording.errors import RecordingError
from observer.types import StereoFrame

_log = logging.getLogger(__name__)


class CommandHandler:
    """Carries out commands and returns their replies.

    Attributes:
        leaving: the engine was asked to shut down.
    """

    def __init__(
        self,
        current: CurrentSource,
        publisher: Publisher,
        truth: LiveTruth,
        *,
        send: Callable[[Reply], None],
        beat: Callable[[], None],
    ) -> None:
        """Set the outputs.

        Args:
            send: sends a reply that comes later, such as the refusal of a cancelled opening.
            beat: called between the steps of lengthy work.
        """
        self._current = current
        self._publisher = publisher
        self._truth = truth
        self._send = send
        self._beat = beat
        self.leaving = False

    def answer(self, request: Request) -> Reply | None:
        """Carry out a command and return the reply; None if it follows later."""
        command = request.command
        try:
            if isinstance(command, OpenSource | BeginCalibration):
                self._current.begin(request, command)
                return None
            if isinstance(command, StopRun):
                return self._stop_run(request.number)
            if isinstance(command, SaveClip):
                self._save_clip(request.number, command)
                return None
            return Reply(request.number, value=self._handle(command))
        except DynamicObserverError as error:
            return refusal(request.number, error)
        except Exception as error:  # noqa: BLE001
            # Process boundary: whatever error a command causes, the engine reports it and lives on.
            _log.exception("%s failed", type(command).__name__)
            return Reply(request.number, error=unexpected(error), refusal="failure")

    def _handle(self, command: object) -> Any:
        match command:
            case RecordRobots():
                return self._record_robots(command)
            case CancelOpening():
                return self._cancel_opening(command)
            case CloseSource():
                return self._close_source()
            case ChangeCalibration():
                return self._change_calibration(command)
            case SetParameters():
                return self._set_parameters(command)
            case SetTruth():
                self._truth.use(command.truth)
                return self._truth.facts()
            case SetPlayback():
                return self._set_playback(command)
            case WatchViews():
                return self._publisher.watch(command.names)
            case PreviewCalibration():
                return self._preview(command.calibration_yaml)
            case MeasureDepth():
                pair = self._newest_pair()
                return measure_depth(
                    pair, command.calibration_yaml, command.u, command.v, self._beat
                )
            case LookAtFloor():
                return look_at_floor(self._publisher.newest)
            case TakeScenePairs():
                return self._take_scene_pairs()
            case ExplainPixel():
                return explain(self._publisher.newest, command.u, command.v)
            case Shutdown():
                self.leaving = True
                return None
        raise InputError("the engine does not support this request")

    def _stop_run(self, number: int) -> Reply | None:
        """Stop the run at once; the recorder's thread replies once the file is complete."""
        session = self._current.observing
        if session is None or session.run_id is None:
            raise NotNow("no run is in progress; start one first")
        recorder = session.end_run()
        if recorder is None:
            return Reply(number)
        recorder.end(lambda: self._send(Reply(number, value=recorder.facts())))
        return None

    def _save_clip(self, number: int, command: SaveClip) -> None:
        """Have the ring buffer saved; the recorder's thread replies."""
        session = self._current.observing
        if session is None or session.recorder is None:
            raise NotNow(
                "the last half minute can be saved only from live cameras or during a run; the "
                "open source can simply be replayed"
            )

        def done(clip: KeptClip | RecordingError) -> None:
            if isinstance(clip, RecordingError):
                self._send(refusal(number, clip))
            else:
                self._send(Reply(number, value=clip))

        session.recorder.save_clip(Path(command.path), command.reserve_bytes, done)

    def _record_robots(self, command: RecordRobots) -> None:
        session = self._current.observing
        if session is not None and session.recorder is not None:
            session.recorder.robots(command.rows, command.incidents)

    def _cancel_opening(self, command: CancelOpening) -> None:
        given_up = self._current.cancel(command.opening, command.reason)
        if given_up is not None:
            self._send(given_up)

    def _close_source(self) -> None:
        given_up = self._current.give_up_opening("it was closed in the meantime")
        if given_up is not None:
            self._send(given_up)
        self._current.close()

    def _change_calibration(self, command: ChangeCalibration) -> tuple[str, ...]:
        session = self._current.calibrating
        if session is None:
            raise NotNow("no calibration is in progress; start one first")
        return session.change(command)

    def _set_parameters(self, command: SetParameters) -> int | None:
        parameters = AllParameters().changed(command.parameters)
        opening, session = self._current.opening, self._current.observing
        if opening is not None:
            opening.parameters = (parameters, command.revision)
        if session is None:
            return None
        session.use(parameters, command.revision)
        return session.player.next_index

    def _set_playback(self, command: SetPlayback) -> PlaybackStatus:
        session = self._current.session
        if session is None:
            raise NotNow("no source is open, so there is nothing to play; open one first")
        session.player.change(command)
        return session.playback_facts(time.monotonic())

    def _take_scene_pairs(self) -> ScenePairs:
        session = self._current.observing
        if session is None:
            raise NotNow(
                "there is no open source whose calibration could be refined; open one first"
            )
        ageing = session.ageing
        return ScenePairs(ageing.pairs, session.calibration_yaml, ageing.vergence)

    def _preview(self, calibration_yaml: str) -> CalibrationPreview:
        session = self._current.calibrating
        board = None if session is None else session.board
        pair = self._newest_pair()
        return preview_calibration(pair, calibration_yaml, self._beat, board)

    def _newest_pair(self) -> StereoFrame:
        session, pair = self._current.session, self._current.raw_pair
        if session is not None and session.player.position is None:
            pair = session.player.held or pair
        if pair is None:
            raise NotNow("there is no image to try the calibration on; open a source first")
        return pair
