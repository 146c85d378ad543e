"""The server, apart from how it is asked: puts its parts together, starts and ends them.

It owns the engine, the drive process and the database. One change at a time: whatever changes
source, run, calibration, parameters or rig holds the lock of ``Activity``.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from pathlib import Path

from app.messages import EngineState
from app.server.activity import Activity
from app.server.background import Background
from app.server.calibrating.manager import CalibrationManager
from app.server.calibrating.session import CalibrationSession
from app.server.contracts import Drive, Engine
from app.server.engine_events import EngineEvents
from app.server.followers import Followers
from app.server.parameters.manager import ParameterManager
from app.server.rig.drive_survey import DriveSurvey
from app.server.rig.store import RigStore
from app.server.robots import AbsentDrive, RobotManager
from app.server.robots.circumstances import Circumstances
from app.server.robots.profile_library import ProfileLibrary
from app.server.runs.manager import RunManager
from app.server.source.live_truth import LiveTruthManager
from app.server.source.manager import SourceManager
from app.server.source.watched_views import Watching
from app.server.telemetry import Telemetry
from app.server.writer import Writer
from app.storage import RunState, Storage
from app.versions import versions
from observer.opening import shown_spec
from observer.rig.rig import Rig


class Server:
    """The door to all that the server does. Everything runs in one event loop; database calls run
    in threads.

    Attributes:
        source: what is open. runs: what is kept of it. calibrating: makes calibrations.
        parameters: parameters and presets. rig: how the cameras stand on their robot.
        driving: the robots. programmes: what they can be told to drive.
        survey: notes a drive, by which the rig is estimated. live_truth: motion capture.
        followers: who is told of everything. watching: which views are looked at.
        telemetry: figures of the running loop. writer: the way into the database.
        activity: excludes one change from another.
        viewers: open live pages. warnings: sentences for the person at the page.
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
        self.engine = engine
        self.storage = storage
        self.clock = clock
        self.viewers = 0
        self.warnings: list[str] = []
        self.writer = Writer()
        self.telemetry = Telemetry()
        self.followers = Followers()
        self.watching = Watching(engine)
        self.survey = DriveSurvey()
        self.rig = RigStore(rig_file)
        self.programmes = ProfileLibrary(programme_folder)
        self._background = Background()
        changed = self.followers.status_changed
        session = CalibrationSession(engine, changed)
        self.activity = Activity(
            run=lambda: self.runs.current, calibrating=lambda: session.source is not None
        )
        self.parameters = ParameterManager(engine, storage, self.writer, self.activity, changed)
        self.live_truth = LiveTruthManager(engine, storage, self.activity, changed, live_truth)
        self.source = SourceManager(
            engine,
            storage,
            self.writer,
            self.activity,
            source=source,
            parameters=self.parameters,
            rig=self.rig,
            live_truth=self.live_truth,
            telemetry=self.telemetry,
            warn=self.warnings.append,
            changed=changed,
        )
        self._drive = drive or AbsentDrive()
        self.driving = RobotManager(
            self._drive,
            rig=lambda: self.rig.rig,
            guard=lambda: self.parameters.group("guard"),
            changed=self.followers.robots_changed,
            run=lambda: self.runs.running,
            newest=lambda: self.source.latest,
            circumstances=self._circumstances,
            check_folder=check_folder,
            clock=clock,
        )
        self.parameters.followed = self.driving.guard_changed
        self.runs = RunManager(
            engine,
            storage,
            self.writer,
            self.activity,
            self.source,
            parameters=self.parameters,
            rig=self.rig,
            robots=self.driving,
            live_truth=self.live_truth,
            clips_at_guard_stops=clips_at_guard_stops,
            soon=self._background.start,
            changed=changed,
            clock=clock,
        )
        self.calibrating = CalibrationManager(storage, self.activity, session, self.source, changed)
        self._events = EngineEvents(
            engine,
            self.activity,
            source=self.source,
            runs=self.runs,
            session=session,
            robots=self.driving,
            survey=self.survey,
            watching=self.watching,
            telemetry=self.telemetry,
            followers=self.followers,
            soon=self._background.start,
            clock=clock,
        )
        self._unsubscribe_drive: Callable[[], None] = lambda: None
        self._started = False

    async def start(self) -> None:
        """Open the database, start the engine and open the first source in the background.

        Raises:
            StorageError: the database cannot be used; nothing was started.
        """
        await asyncio.to_thread(self._load)
        self.writer.start()
        self._started = True
        self._events.follow()
        self._background.start(self.watching.run())
        self.runs.begin()
        self.driving.start()
        self._unsubscribe_drive = self._drive.subscribe(self.runs.clips.drive_said)
        await self.engine.start()
        # An engine that was up before somebody listened.
        if self.engine.health.alive:
            self._events.engine_started(self.engine.health.generation)

    async def stop(self) -> None:
        """End driving, the run, the engine and the database; safe to call twice and half-way."""
        # The robots stop first, while everything that hears of it is still there.
        await self.driving.stop()
        self._events.unfollow()
        self._unsubscribe_drive()
        await self._background.cancel()
        await self.calibrating.session.computation.cancel()
        if self.runs.running is not None:
            reason = "the server was stopped during the run"
            await self.runs.close(RunState.INTERRUPTED, reason)
        await self.engine.stop()
        if self._started:
            await asyncio.to_thread(self.writer.stop)
        await asyncio.to_thread(self.storage.close)

    def _load(self) -> None:
        self.storage.open()
        self.warnings.extend(self.storage.warnings)
        self.runs.load()
        loaded = (self.parameters.load(), self.rig.load())
        self.warnings.extend(warning for warning in loaded if warning is not None)
        self.live_truth.load()
        self.source.load()

    async def change_rig(self, changed: Callable[[], Rig]) -> None:
        """Put a rig into force; the open source begins again with it, where it would differ.

        Robots whose port or model is another are connected anew, disarmed.

        Args:
            changed: makes it of the one in force, which nobody else changes meanwhile.

        Raises:
            Conflict: a run or a calibration is going, and it would be observed otherwise.
            FieldError: as ``changed`` raises, or it cannot be written.
        """
        async with self.activity.lock:
            rig = changed()
            alike = self.rig.observes_alike(rig)
            if not alike:
                self.activity.refuse_in_run("stop it before you change the rig")
                self.activity.refuse_calibrating()
            await asyncio.to_thread(self.rig.keep, rig)
            self.driving.rig_changed(self.source.state)
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
