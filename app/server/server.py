"""The server without its web layer: assembly, start and shutdown of its parts.

It owns the engine, the drive process and the database. Changes happen one at a time: a change of
source, run, calibration, parameters or rig holds the shared lock.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from pathlib import Path

from app.contract.events import EngineState
from app.server.calibrating.manager import CalibrationManager
from app.server.contracts import Drive, Engine
from app.server.engine_events import EngineEvents
from app.server.parameters.manager import ParameterManager
from app.server.rig.drive_survey import DriveSurvey
from app.server.rig.store import RigStore
from app.server.robots import AbsentDrive, RobotManager
from app.server.robots.circumstances import Circumstances
from app.server.robots.profile_library import ProfileLibrary
from app.server.runs.manager import RunManager
from app.server.shared import Shared
from app.server.source.live_truth import LiveTruthManager
from app.server.source.manager import SourceManager
from app.server.source.watched_views import Watching
from app.server.steps.manager import MethodStepsManager
from app.storage import RunState, Storage
from app.versions import versions
from observer.opening import shown_spec
from observer.rig.rig import Rig


class Server:
    """Entry point to all functions of the server.

    Everything runs in one event loop; database calls run in threads.

    Attributes:
        source: the open source. runs: recorded runs. calibrating: makes calibrations.
        parameters: parameters and presets. rig: pose of the cameras on their robot.
        driving: the robots. programmes: programmes that they can drive.
        survey: records a drive, to estimate the rig. live_truth: live motion capture.
        steps: the paper's method on one pair of frames.
        watching: views being watched. viewers: open live pages.
        shared: common parts, among them engine, storage, clock, followers and telemetry.
    """

    def __init__(
        self,
        engine: Engine,
        storage: Storage,
        *,
        source: str,
        rig_file: Path | None = None,
        programme_folder: Path | None = None,
        check_folder: Path | None = None,
        drive: Drive | None = None,
        clips_at_guard_stops: bool = True,
        live_truth: str | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.shared = shared = Shared(engine, storage, clock)
        self.engine, self.storage, self.clock = engine, storage, clock
        self.followers, self.telemetry = shared.followers, shared.telemetry
        self.viewers = 0
        self.watching = Watching(engine)
        self.survey = DriveSurvey()
        self.rig = RigStore(rig_file)
        self.programmes = ProfileLibrary(programme_folder)
        self.parameters = ParameterManager(shared)
        self.live_truth = LiveTruthManager(shared, live_truth)
        self.source = SourceManager(shared, source, self.parameters, self.rig, self.live_truth)
        self._drive = drive or AbsentDrive()
        self.driving = RobotManager(
            self._drive,
            rig=lambda: self.rig.rig,
            guard=lambda: self.parameters.group("guard"),
            changed=self.followers.robots_changed,
            run=lambda: self.runs.running,
            source_time=self.source.time,
            circumstances=self._circumstances,
            check_folder=check_folder,
            clock=clock,
        )
        self.parameters.followed = self.driving.guard_changed
        self.runs = RunManager(
            shared,
            self.source,
            self.parameters,
            self.rig,
            self.driving,
            self.live_truth,
            clips_at_guard_stops=clips_at_guard_stops,
        )
        self.calibrating = CalibrationManager(shared, self.source)
        self.steps = MethodStepsManager(
            storage, self.source, self.parameters, self.driving.any_driven
        )
        session = self.calibrating.session
        shared.run = lambda: self.runs.current
        shared.calibrates = lambda: session.source is not None
        shared.preparing = lambda: self.source.state.preparing is not None
        self._events = EngineEvents(
            shared, self.source, self.runs, session, self.driving, self.survey, self.watching
        )
        self._unsubscribe_drive: Callable[[], None] = lambda: None
        self._started = False

    async def start(self) -> None:
        """Open the database, start the engine and open the first source in the background.

        Raises:
            StorageError: the database cannot be used; nothing was started.
        """
        await asyncio.to_thread(self._load)
        self.shared.writer.start()
        self._started = True
        self._events.follow()
        self.shared.background.start(self.watching.run())
        self.runs.begin()
        self.driving.start()
        self._unsubscribe_drive = self._drive.subscribe(self.runs.clips.drive_said)
        await self.engine.start()
        # The engine may have started before the subscription.
        if self.engine.health.alive:
            self._events.engine_started(self.engine.health.generation)

    async def stop(self) -> None:
        """Stop driving, the run, the engine and the database.

        Safe to call twice, and after a start that failed half-way.
        """
        # Stop the robots first, while everything that records it still runs.
        await self.driving.stop()
        self._events.unfollow()
        self._unsubscribe_drive()
        await self.shared.background.cancel()
        await self.calibrating.session.computation.cancel()
        await self.runs.reruns.close()
        await self.steps.close()
        if self.runs.running is not None:
            reason = "the server was shut down during the run"
            await self.runs.close(RunState.INTERRUPTED, reason)
        await self.engine.stop()
        if self._started:
            await asyncio.to_thread(self.shared.writer.stop)
        await asyncio.to_thread(self.storage.close)

    def _load(self) -> None:
        self.storage.open()
        self.shared.warnings.extend(self.storage.warnings)
        self.runs.load()
        loaded = (self.parameters.load(), self.rig.load(), self.live_truth.load())
        self.shared.warnings.extend(warning for warning in loaded if warning is not None)
        self.source.load()

    async def change_rig(self, changed: Callable[[], Rig]) -> None:
        """Make a rig the current one; reopen the source if it would be observed differently.

        Robots with a changed port or model are reconnected, disarmed.

        Args:
            changed: returns the new rig, made from the current one; called with the lock held.

        Raises:
            Conflict: a run or a calibration is in progress and would be observed differently.
            FieldError: raised by ``changed``, or the rig cannot be written.
        """
        async with self.shared.lock:
            rig = changed()
            alike = self.rig.observes_alike(rig)
            if not alike:
                self.shared.refuse_in_run("stop it before you change the rig")
                self.shared.refuse_calibrating()
            await asyncio.to_thread(self.rig.keep, rig)
            self.driving.source_changed(self.source.state)
            if not alike and self.source.state.state is EngineState.PREVIEW:
                await self.source.restore()
        self.followers.status_changed()

    def _circumstances(self) -> Circumstances:
        wanted = self.source.wanted
        return Circumstances.of(
            software=versions(),
            source=shown_spec(wanted.source),
            calibration=None if wanted.calibration is None else wanted.calibration.id,
            rig=self.rig.rig,
            guard=self.parameters.group("guard"),
        )
