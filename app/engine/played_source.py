"""Open source and its player, independent of how the frames are used."""

from __future__ import annotations

import time
from collections.abc import Callable

from app.contract.commands import BeginCalibration, OpenSource
from app.contract.events import EngineState, StateEvent
from app.contract.status import LiveCamera, LiveStatus, PlaybackStatus
from app.contract.values import filled
from app.engine.playback import Player
from observer.opening import OpenedSource
from observer.sources.contract import LiveSource, SkippedFrame

# Number of unreadable frames skipped while opening to find the first readable one.
TRIES_FOR_A_PAIR = 20
# Seconds: a live source has delivered before it counts as open, so the next pair follows soon.
FIRST_PAIR_S = 2.0

OpeningCommand = OpenSource | BeginCalibration
# Opens a source.
SourceOpener = Callable[[str], OpenedSource]


class LentSource(OpenedSource):
    """Live source that belongs to its old session until the new one takes it over.

    Only one program can open its cameras, and only once. The robots of its world, if any, are
    handed on with it, so that their driver need not reconnect. No live source has truth.
    """


class PlayedSource:
    """Source and its player. Used by one thread at a time.

    Attributes:
        spec: the text it was opened with, passwords included.
        opened: the source, and the robots of its world, reachable while it is observed.
        resting: it is not read, because its source is being handed on.
        skipped: unreadable frames before the first readable one, while opening.
    """

    def __init__(
        self, spec: str, opened: OpenedSource, player: Player, skipped: tuple[SkippedFrame, ...]
    ) -> None:
        self.spec = spec
        self.opened = opened
        self.source = source = opened.source
        self._live = source if isinstance(source, LiveSource) else None
        self.player = player
        self.skipped = skipped
        self.resting = False

    def state(self, now: float) -> StateEvent:
        """Return the engine's state with this source, without live motion capture."""
        return StateEvent(
            EngineState.PREVIEW,
            reason=None,
            source=self.source.info,
            playback=self.playback_facts(now),
            live=self._live_facts(),
        )

    def playback_facts(self, now: float) -> PlaybackStatus:
        """Return the playback as ``StateEvent.playback`` holds it."""
        achieved = self.player.achieved_rate(now)
        return filled(
            PlaybackStatus,
            self.player,
            frame=self.player.position,
            frame_count=self.source.info.frame_count,
            achieved_rate=None if achieved is None else round(achieved, 2),
        )

    def tend(self) -> None:
        """Let a live source decode ahead; call it in the reading thread, between two reads."""
        if self._live is not None:
            self._live.tend()

    def _live_facts(self) -> LiveStatus | None:
        if self._live is None:
            return None
        report = self._live.report()
        cameras = [filled(LiveCamera, camera) for camera in report.cameras]
        return filled(
            LiveStatus,
            report,
            cameras=cameras,
            trouble=self.player.trouble,
            reduced_to=self.reduced_to,
        )

    @property
    def reduced_to(self) -> str | None:
        """Describe in words what reduced processing still does; None for full processing."""
        return None

    def again(self) -> OpeningCommand:
        """Return the command that would reopen it in its present state."""
        raise NotImplementedError

    def lend(self) -> LentSource:
        """Return the source for another session, as if newly opened."""
        return LentSource(self.source, None, self.opened.robots)

    def take_over(self, lender: PlayedSource) -> None:
        """Own the lent source from now on: only this session's ``close`` closes it."""
        self.opened, lender.opened = lender.opened, self.opened

    def close(self) -> None:
        """Release the source and the robots of its world, unless they are lent."""
        close_opened(self.opened)


def close_opened(opened: OpenedSource) -> None:
    """Release an opened source and the robots of its world, unless they are lent."""
    if isinstance(opened, LentSource):
        return
    if opened.robots is not None:
        opened.robots.close()
    opened.source.close()


def read_first(player: Player) -> tuple[SkippedFrame, ...]:
    """Read the first frame ahead.

    Some sources do heavy work for it, which would stop the heartbeat if done in the engine's loop.

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
