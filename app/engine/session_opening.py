"""Opening of a source with everything needed to observe it."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Protocol

from app.contract.commands import OpenSource
from app.engine.playback import Player
from app.engine.played_source import (
    FIRST_PAIR_S,
    TRIES_FOR_A_PAIR,
    SourceOpener,
    close_opened,
    read_first,
)
from app.engine.recorders import Recorders
from app.engine.session import FrameObserver, Session
from observer.calibration.formats.opencv_file import (
    calibration_id,
    calibration_text,
    read_calibration,
)
from observer.camera import StereoCalibration
from observer.errors import CalibrationError
from observer.guard.parameters import AllParameters
from observer.mount import CameraMount
from observer.parameters import Parameters
from observer.rig.applied import mount_for
from observer.rig.rig_file import read_rig
from observer.sources.contract import SkippedFrame, Source
from observer.types import StereoFrame


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
        pair: a frame of the source for trying out a calibration; None where it has no readable one.
    """

    def __init__(self, message: str, pair: StereoFrame | None) -> None:
        self.pair = pair
        super().__init__(message)


def open_session(
    command: OpenSource,
    open_source: SourceOpener,
    make_observer: ObserverFactory,
    clock: Callable[[], float],
    recorders: Recorders,
) -> Session:
    """Open the source and all that belongs to it, and read its first frame.

    If refused, nothing stays open.

    Raises:
        InputError: one sentence on the fault in the source, calibration or a parameter.
        RecordingError: a recording was ordered and is not possible.
    """
    parameters = AllParameters().changed(command.parameters)
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
        # Before the first frame: it takes a second or two, and again once robots follow it.
        ports = () if opened.robots is None else opened.robots.serve()
        player = Player(opened.source, paused=command.paused, rate=command.rate, loop=command.loop)
        skipped = read_first(player)
        info = opened.source.info
        begin = partial(recorders.begin, info=info, calibration_yaml=text, mount=mount)
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


def _check_size(calibration: StereoCalibration, source: Source) -> None:
    info = source.info
    if (calibration.width, calibration.height) != (info.width, info.height):
        raise CalibrationError(
            f"the calibration is for images of {calibration.width}x{calibration.height} pixels, "
            f"but {info.spec} delivers {info.width}x{info.height}; choose the calibration that "
            f"was made with these images"
        )


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
