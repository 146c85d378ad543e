"""One open source with its player, observer and truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any, Protocol

from app.engine.playback import Player
from app.engine.truth_matching import TruthMatcher
from app.messages import OpenSource
from observer.calibration.formats.opencv_file import calibration_text, read_calibration
from observer.camera import StereoCalibration, StereoCamera
from observer.errors import CalibrationError
from observer.mount import CameraMount
from observer.opening import OpenedSource
from observer.parameters import Parameters
from observer.sources.contract import SkippedFrame, Source
from observer.types import Observation, StereoFrame, Trace

# How many unreadable frames are passed over while opening to find the first readable one.
_TRIES_FOR_A_PAIR = 20


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


class Session:
    """What belongs to one open source. Used by one thread at a time."""

    def __init__(
        self,
        command: OpenSource,
        opened: OpenedSource,
        observer: FrameObserver,
        player: Player,
        skipped: tuple[SkippedFrame, ...],
        calibration_yaml: str,
    ) -> None:
        """
        Args:
            calibration_yaml: what the observer was made with, as text.
            skipped: frames that could not be read while opening, before the first one.
        """
        self.skipped = skipped
        self.calibration_yaml = calibration_yaml
        self.source = opened.source
        self.observer = observer
        self.player = player
        self.run_id = command.run_id
        self.first_segment = command.segment
        self.parameters_revision = command.parameters_revision
        self.truth = None if opened.truth is None else TruthMatcher(opened.truth)
        self.segment = command.segment

    def use(self, parameters: Parameters, revision: int) -> None:
        """Observe with these parameters from the next frame on."""
        self.observer.use(parameters, revision)
        self.parameters_revision = revision

    def camera_facts(self) -> dict[str, Any]:
        """The rectified camera as ``StateEvent.camera`` holds it."""
        return asdict(self.observer.camera)

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
            "achieved_rate": None if achieved is None else round(achieved, 2),
        }

    def close(self) -> None:
        self.source.close()


def open_session(
    command: OpenSource,
    open_source: SourceOpener,
    make_observer: ObserverFactory,
    clock: Callable[[], float],
) -> Session:
    """Open the source and all that belongs to it, its first frame already read; on any refusal
    nothing stays open.

    Raises:
        InputError: one sentence of what is wrong with the source, calibration or a parameter.
    """
    parameters = parse_parameters(command.parameters)
    calibration = (
        None
        if command.calibration_yaml is None
        else read_calibration(command.calibration_yaml, name="the given calibration")
    )
    opened = open_source(command.source)
    try:
        calibration = calibration or opened.source.calibration
        if calibration is None:
            raise NotCalibrated(
                f"{command.source} brings no calibration.yaml of its own; choose a calibration "
                f"for it, or put calibration.yaml into its folder",
                _first_pair(opened.source),
            )
        _check_size(calibration, opened.source)
        observer = make_observer(
            calibration,
            parameters,
            parameters_revision=command.parameters_revision,
            mount=opened.source.info.mount,
            clock=clock,
        )
        player = Player(opened.source, paused=command.paused, rate=command.rate, loop=command.loop)
        skipped = _read_first(player)
        # A given text is handed back as it was given, so that it keeps its content hash.
        text = command.calibration_yaml or calibration_text(calibration)
        return Session(command, opened, observer, player, skipped, text)
    except BaseException:
        opened.source.close()
        raise


def parse_parameters(values: Mapping[str, Any]) -> Parameters:
    """The declared defaults with these values, by dotted name.

    Raises:
        ParameterError: naming every refused field and its range.
    """
    return Parameters().changed(values)


def _read_first(player: Player) -> tuple[SkippedFrame, ...]:
    # Some sources do their heavy work at the first frame, which would stop the engine's heart.
    skipped: list[SkippedFrame] = []
    while player.wants_reading and len(skipped) < _TRIES_FOR_A_PAIR:
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
    for _ in range(_TRIES_FOR_A_PAIR):
        item = source.read()
        if isinstance(item, StereoFrame):
            return item
        if not isinstance(item, SkippedFrame):
            return None
    return None
