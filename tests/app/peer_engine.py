"""An engine within the test's own process: keeps state instead of observing."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from app.contract.answers import CalibrationPreview, FloorPoints, KeptClip, Opened, ScenePairs
from app.contract.calibrating import BoardLook, PlaceDepth
from app.contract.commands import (
    BeginCalibration,
    ChangeCalibration,
    CloseSource,
    ExplainPixel,
    LookAtFloor,
    MeasureDepth,
    OpenSource,
    PreviewCalibration,
    SaveClip,
    SetParameters,
    SetPlayback,
    SetTruth,
    StopRun,
    TakeScenePairs,
    ToEngine,
    WatchViews,
)
from app.contract.events import (
    BoardLookEvent,
    BoardViewsEvent,
    EngineLostEvent,
    EngineStartedEvent,
    EngineState,
    Event,
    ObservationEvent,
    StateEvent,
)
from app.contract.pixel import Pixel, PixelObstacle
from app.contract.status import PlaybackStatus, RecordingStatus
from app.contract.views import CLOUD_NAME, VIEW_NAMES
from app.engine.motion_listening import CONNECTING
from app.engine.truth_facts import truth_facts
from app.runtime.errors import ProcessRefused, ProcessUnavailable
from app.runtime.latest import LatestReader, LatestWriter, create_slot
from app.runtime.supervisor import ProcessHealth
from observer.calibration.boards.board import BoardView
from observer.camera import StereoCamera
from observer.mount import CameraMount
from observer.robots.contract import RobotPort
from observer.sources.contract import SourceInfo

from .engine_values import JPEG, floor_points, line, rectified_calibration, sighting_of, truth


class PeerEngine:
    """Fulfils ``app.server.Engine`` by keeping state instead of observing.

    Sources: ``simulated:lab`` and anything else opens; ``missing`` is refused as input and
    ``no room`` as on a full disk.
    """

    def __init__(self) -> None:
        self._slots = {name: create_slot(1 << 20) for name in (*VIEW_NAMES, CLOUD_NAME)}
        self.writers = {name: LatestWriter(fd) for name, fd in self._slots.items()}
        readers = {name: LatestReader(fd) for name, fd in self._slots.items()}
        self.cloud = readers.pop(CLOUD_NAME)
        self.views = readers
        self.commands: list[ToEngine[Any]] = []
        self.subscribers: list[Callable[[Event], None]] = []
        self.generation = 0
        self.alive = False
        self.opened: OpenSource | None = None
        # The calibration in progress, its views, and whether both cameras see the board.
        self.calibrating: BeginCalibration | None = None
        self.captured: list[BoardView] = []
        self.board_seen = False
        self.devices: tuple[str, ...] = ()
        # The world that the source shows, and the robots in it.
        self.world: str | None = None
        self.robots: tuple[RobotPort, ...] = ()
        self.parameters: dict[str, Any] = {}
        self.watched: tuple[str, ...] = ()
        self.frame = 0
        self.sequence = 0
        self.playback: dict[str, Any] = {}
        # Makes observations as large as a test needs.
        self.padding = ""
        # Draw newly watched views at once, like the real engine.
        self.draw_on_watch = True

    async def start(self) -> None:
        self.start_process()

    def start_process(self) -> None:
        self.generation += 1
        self.alive = True
        self.opened = self.calibrating = None
        self.sequence = 0
        self.publish(EngineStartedEvent(self.generation, 1000 + self.generation))
        self.publish(self.state())

    def lose(self, reason: str = "the engine was killed") -> None:
        self.alive = False
        self.publish(EngineLostEvent(self.generation, reason))

    async def stop(self) -> None:
        self.alive = False
        if not self._slots:
            return
        for slot in (*self.writers.values(), *self.views.values(), self.cloud):
            slot.close()
        for fd in self._slots.values():
            os.close(fd)
        self._slots = {}

    def subscribe(self, callback: Callable[[Event], None]) -> Callable[[], None]:
        self.subscribers.append(callback)
        return lambda: self.subscribers.remove(callback)

    def publish(self, event: Event) -> None:
        for callback in tuple(self.subscribers):
            callback(event)

    @property
    def health(self) -> ProcessHealth:
        pid = 1000 + self.generation if self.alive else None
        return ProcessHealth(self.generation, pid, self.alive, max(0, self.generation - 1), 0.01, 0)

    async def request(
        self, command: ToEngine[Any], timeout_s: float = 10.0, *, repeatable: bool = False
    ) -> Any:
        del repeatable
        assert timeout_s > 0
        if not self.alive:
            raise ProcessUnavailable("the engine is being replaced")
        self.commands.append(command)
        match command:
            case OpenSource():
                return self._open(command)
            case BeginCalibration():
                return self._begin(command)
            case ChangeCalibration():
                return self._change(command)
            case CloseSource():
                self.opened = self.calibrating = None
                self.publish(self.state())
                return None
            case MeasureDepth():
                return self._measure(command)
            case LookAtFloor():
                self.frame += 1
                return FloorPoints(self.frame, floor_points(self.frame))
            case TakeScenePairs():
                text = self.opened and self.opened.calibration_yaml
                return ScenePairs((), text or rectified_calibration())
            case SetParameters():
                self.parameters = dict(command.parameters)
                return self.frame + 1 if self.opened else None
            case SetPlayback():
                if self.opened is None:
                    raise ProcessRefused("no source is open", "state")
                changes = asdict(command)
                for name in ("paused", "rate", "loop"):
                    if changes[name] is not None:
                        self.playback[name] = changes[name]
                self.publish(self.state())
                return PlaybackStatus(**self.playback)
            case SetTruth():
                if self.opened is not None:
                    self.opened = replace(self.opened, truth=command.truth)
                self.publish(self.state())
                return self.state().truth
            case StopRun():
                if self.opened is None or self.opened.run_id is None:
                    raise ProcessRefused("no run is going", "state")
                record, self.opened = self.opened.record, replace(self.opened, run_id=None)
                self.publish(self.state())
                return record and self.recording(bytes=4096)
            case SaveClip():
                if self.opened is None or self.opened.run_id is None:
                    raise ProcessRefused("the open source can simply be replayed", "state")
                return KeptClip(512, 29.9)
            case WatchViews():
                new = set(command.names) - set(self.watched)
                self.watched = command.names
                if self.draw_on_watch:
                    for name in new & set(VIEW_NAMES):
                        self.draw(name)
                return None
            case PreviewCalibration():
                return CalibrationPreview(JPEG, 0.125, 42)
            case ExplainPixel():
                return self._explain(command)
        return None

    def _explain(self, command: ExplainPixel) -> Pixel:
        if self.sequence == 0:
            raise ProcessRefused("no frame has been observed yet", "state")
        if not (0 <= command.u < 512 and 0 <= command.v < 256):
            raise ProcessRefused("the pixel is outside the image of 512 x 256 pixels", "input")
        return Pixel(
            frame=self.frame - 1,
            segment=0,
            u=command.u,
            v=command.v,
            verdict="dynamic",
            sentence="It moves at 0.40 m/s.",
            numbers={"residual_px": 4.2, "depth_m": None},
            would_change="With flow.residual_threshold_px at 4.21 px or above it would not.",
            obstacle=PixelObstacle(7, True, "its flow differs"),
        )

    def _begin(self, command: BeginCalibration) -> Opened:
        if command.source == "missing":
            raise ProcessRefused("there is no folder missing; name one that exists", "input")
        if self.opened is not None and self.opened.run_id is not None:
            raise ProcessRefused("a run is going", "state")
        self.opened, self.calibrating = None, command
        self.captured = list(command.views)
        self.publish(self.state())
        return Opened(self.state(), None)

    def _change(self, command: ChangeCalibration) -> tuple[str, ...]:
        if self.calibrating is None:
            raise ProcessRefused("no calibration is in progress", "state")
        if command.capture:
            if not self.board_seen:
                raise ProcessRefused("the board is not visible to both cameras right now", "state")
            self.capture()
        if command.undo:
            if not self.captured:
                raise ProcessRefused("there is no view to undo", "state")
            self.captured.pop()
            self.publish(BoardViewsEvent(self._names()))
        if command.remove is not None:
            self.captured = [view for view in self.captured if view.name != command.remove]
            self.publish(BoardViewsEvent(self._names()))
        return self._names()

    def _names(self) -> tuple[str, ...]:
        return tuple(view.name for view in self.captured)

    def capture(self, view: BoardView | None = None) -> BoardView:
        """Capture one more view, as when a person holds the board still."""
        assert self.calibrating is not None
        number = max((int(name) for name in self._names()), default=0) + 1
        seen = sighting_of(self.calibrating.board)
        taken = BoardView(str(number), seen, seen) if view is None else view
        self.captured.append(taken)
        self.publish(BoardViewsEvent(self._names(), taken, (JPEG, JPEG)))
        return taken

    def look(self, **more: Any) -> None:
        """Report that one more pair was examined for the board."""
        look = BoardLook(words="Hold the board still", frame=self.frame, seen=[54, 54])
        self.publish(BoardLookEvent(replace(look, **more), time.monotonic()))

    def _measure(self, command: MeasureDepth) -> PlaceDepth:
        if command.u >= 512 or command.v >= 256:
            raise ProcessRefused("the pixel is outside the image of 512 x 256", "input")
        return PlaceDepth(range_m=2.0, depth_m=1.9, disparity_px=28.0)

    def _open(self, command: OpenSource) -> Opened:
        if command.source == "missing":
            raise ProcessRefused("there is no folder missing; name one that exists", "input")
        if command.source == "uncalibrated" and command.calibration_yaml is None:
            raise ProcessRefused("uncalibrated has no calibration", "input")
        if command.source == "no room":
            raise ProcessRefused(
                "the recording cannot continue: only 3 MB are left on the disk", "full"
            )
        self.opened, self.calibrating = command, None
        self.parameters = dict(command.parameters)
        self.frame = 0
        self.playback = {
            "paused": command.paused,
            "rate": command.rate,
            "loop": command.loop,
            "frame": 0,
            "frame_count": 100,
            "ended": False,
            "achieved_rate": 1.0,
        }
        self.publish(self.state())
        return Opened(self.state(), command.calibration_yaml or rectified_calibration())

    def state(self, **more: Any) -> StateEvent:
        opened = self.opened
        if opened is None and self.calibrating is None:
            return StateEvent(EngineState.IDLE, None)
        shown = opened or self.calibrating
        assert shown is not None
        source = SourceInfo(
            spec=shown.source,
            kind="simulated",
            width=512,
            height=256,
            frame_rate=15.0,
            frame_count=100,
            mount_height_m=0.4,
            mount_tilt_rad=0.1,
            devices=self.devices,
        )
        if opened is None:
            return StateEvent(EngineState.CALIBRATING, None, source=source)
        camera = StereoCamera(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)
        return (
            StateEvent(
                EngineState.PREVIEW if opened.run_id is None else EngineState.RUNNING,
                None,
                source=source,
                playback=PlaybackStatus(**self.playback),
                camera=camera,
                run_id=opened.run_id,
                segment=opened.segment,
                has_truth=True,
                mount=CameraMount(0.4, 0.1),
                world=self.world,
                robots=self.robots,
                truth=None
                if opened.truth is None
                else truth_facts(
                    opened.truth, CONNECTING, None, None, "not aligned yet: only a peer"
                ),
            )
            if not more
            else replace(self.state(), **more)
        )

    @staticmethod
    def recording(**more: Any) -> RecordingStatus:
        """Return the status of a recording, as the engine reports it."""
        return replace(RecordingStatus("jpeg", 0, 0.0, 0, None), **more)

    def draw(self, name: str) -> None:
        header = {
            "frame": self.frame,
            "time": 0.0,
            "received": time.monotonic(),
            "width": 512,
            "height": 256,
        }
        self.writers[name].write(header, JPEG)

    def draw_cloud(self, points: int = 50) -> None:
        rng = np.random.default_rng(self.frame)
        header = {
            "frame": self.frame,
            "time": 0.0,
            "received": time.monotonic(),
            "count": points,
            "T_world_camera": np.eye(4).ravel().tolist(),
            "segment": 0,
        }
        cloud = rng.uniform(1, 3, (points, 3)).astype(np.float32)
        colors = rng.integers(0, 255, (points, 3), dtype=np.uint8)
        self.writers[CLOUD_NAME].write(header, cloud.tobytes(), colors.tobytes())

    def observe(self, **more: Any) -> ObservationEvent:
        """Publish one more frame with one obstacle; also draw what is watched."""
        opened = self.opened
        assert opened is not None
        for name in self.watched:
            if name in VIEW_NAMES:
                self.draw(name)
            else:
                self.draw_cloud()
        event = ObservationEvent(
            sequence=self.sequence,
            line=line(self.frame, opened.segment, opened.parameters_revision, self.padding),
            truth=[truth(self.frame)],
            received=time.monotonic(),
            published=time.monotonic(),
            frame_skips=0,
            run_id=opened.run_id,
        )
        event = replace(event, **more)
        self.frame += 1
        self.sequence += 1
        self.publish(event)
        return event
