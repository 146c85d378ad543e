"""Open source and its player, independent of the frames' use."""

from __future__ import annotations

import time
from collections.abc import Callable

from app.contract.commands import BeginCalibration, OpenSource
from app.contract.events import EngineState
from app.contract.status import (
    AgeingStatus,
    LiveCamera,
    LiveStatus,
    PlaybackStatus,
    RecordingStatus,
)
from app.contract.values import filled
from app.engine.playback import Player
from observer.camera import StereoCamera
from observer.mount import CameraMount
from observer.opening import OpenedSource
from observer.robots.contract import RobotPort, RobotWorld
from observer.sources.contract import LiveSource, SkippedFrame, Source

# Number of unreadable frames skipped while opening to find the first readable one.
TRIES_FOR_A_PAIR = 20
# A live source has delivered before it counts as open; the next pair follows soon.
FIRST_PAIR_S = 2.0

# Opens a source.
OpeningCommand = OpenSource | BeginCalibration
SourceOpener = Callable[[str], OpenedSource]


class PlayedSource:
    """Source and its player. Used by one thread at a time.

    Attributes:
        spec: the text it was opened with, passwords included.
        resting: it is not read, because its source is being handed on.
        skipped: frames that could not be read while opening, before the first one.
        robots: of the source's own world; reached while it is observed.
        run_id, segment: of the run being kept; None and 0 without one.
        has_truth: the source has truth of its own.
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
        """Return the engine state for this source."""
        return EngineState.PREVIEW

    def camera_facts(self) -> StereoCamera | None:
        """Return the rectified camera as ``StateEvent.camera`` holds it."""
        return None

    def mount_facts(self) -> CameraMount | None:
        """Return the mount as ``StateEvent.mount`` holds it."""
        return None

    def ageing_facts(self) -> AgeingStatus | None:
        """Return the ageing as ``StateEvent.ageing`` holds it."""
        return None

    def recording_facts(self) -> RecordingStatus | None:
        """Return the recording as ``StateEvent.recording`` holds it."""
        return None

    @property
    def world(self) -> str | None:
        """Return the world as ``StateEvent.world`` holds it."""
        return None

    def robot_facts(self) -> tuple[RobotPort, ...]:
        """Return the robots as ``StateEvent.robots`` holds them."""
        return ()

    def playback_facts(self, now: float) -> PlaybackStatus:
        """Return the playback as ``StateEvent.playback`` holds it."""
        player = self.player
        achieved = player.achieved_rate(now)
        return PlaybackStatus(
            paused=player.paused,
            rate=player.rate,
            loop=player.loop,
            frame=player.position,
            frame_count=self.source.info.frame_count,
            ended=player.ended,
            seekable=player.seekable,
            achieved_rate=None if achieved is None else round(achieved, 2),
        )

    def tend(self) -> None:
        """Let a live source decode ahead; for the thread that reads, between two reads."""
        if self._live is not None:
            self._live.tend()

    def live_facts(self) -> LiveStatus | None:
        """Return the live figures as ``StateEvent.live`` holds them."""
        if self._live is None:
            return None
        report = self._live.report()
        cameras = [filled(LiveCamera, camera) for camera in report.cameras]
        return filled(LiveStatus, report, cameras=cameras, trouble=self.player.trouble)

    def again(self) -> OpeningCommand:
        """Return the command that would reopen it in its present state."""
        raise NotImplementedError

    def close(self) -> None:
        """Release the source and the robots of its world."""
        if self.robots is not None:
            self.robots.close()
        self.source.close()


def close_opened(opened: OpenedSource) -> None:
    """Release an opened source that will not be played."""
    if opened.robots is not None:
        opened.robots.close()
    opened.source.close()


def read_first(player: Player) -> tuple[SkippedFrame, ...]:
    """Read the first frame ahead.

    Some sources do their heavy work at that point, which would stop the engine's heartbeat.

    Returns:
        The frames that could not be read before it.
    """
    skipped: list[SkippedFrame] = []
    until = time.monotonic() + FIRST_PAIR_S
    while player.wants_reading and len(skipped) < TRIES_FOR_A_PAIR and time.monotonic() < until:
        frame = player.read_ahead()
        if frame is not None:
            skipped.append(frame)
    return tuple(skipped)
