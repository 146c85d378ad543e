"""Calibration session: looks for a board in the source's pairs and collects views of it."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace

from app.contract.calibrating import BoardLook
from app.contract.commands import BeginCalibration, ChangeCalibration
from app.contract.events import BoardLookEvent, BoardViewsEvent, EngineState, StateEvent
from app.contract.views import CAMERA_NAMES
from app.engine.errors import NotNow, unexpected
from app.engine.playback import Player
from app.engine.played_source import PlayedSource, SourceOpener, close_opened, read_first
from observer.calibration.boards.board import Board, BoardSighting, BoardView
from observer.calibration.boards.board_pictures import draw_board, small_picture
from observer.calibration.boards.collecting import Look, ViewCollector
from observer.calibration.boards.detection import detect_board
from observer.calibration.cover_check import CoverCheck
from observer.camera import as_gray
from observer.errors import InputError
from observer.opening import OpenedSource
from observer.sources.contract import SkippedFrame
from observer.types import Image, StereoFrame

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class BoardPublisher:
    """Publisher of the board detections.

    Attributes:
        send: takes events and never blocks.
        show: shows those images of a pair that are watched; the function draws one by name.
        beat: called between steps, each of which takes some ten milliseconds.
    """

    send: Callable[[object], None]
    show: Callable[[StereoFrame, Callable[[str], Image]], None]
    beat: Callable[[], None]


def open_calibration(
    command: BeginCalibration, open_source: SourceOpener, publisher: BoardPublisher
) -> BoardSession:
    """Open the source and read its first frame; if refused, leave nothing open.

    Raises:
        InputError: the source cannot be used; one sentence says why.
    """
    opened = open_source(command.source)
    try:
        player = Player(opened.source, paused=False, rate=1.0, loop=True)
        skipped = read_first(player)
        return BoardSession(command, opened, player, skipped, publisher)
    except BaseException:
        close_opened(opened)
        raise


class BoardSession(PlayedSource):
    """Source being calibrated: looks for the board in every pair and collects views of it.

    It runs in the loop's own thread: the search takes about 15 ms per image, board or no board, and
    a live source keeps only its newest pair in the meantime.

    Attributes:
        board: the board to look for.
    """

    def __init__(
        self,
        command: BeginCalibration,
        opened: OpenedSource,
        player: Player,
        skipped: tuple[SkippedFrame, ...],
        publisher: BoardPublisher,
    ) -> None:
        super().__init__(command.source, opened, player, skipped)
        info = opened.source.info
        self._command = command
        self.board: Board = command.board
        self._publisher = publisher
        self._collector = ViewCollector(command.board, (info.width, info.height), command.views)
        self._collector.automatic = command.automatic
        self._cover = CoverCheck()
        self._newest: StereoFrame | None = None

    def state(self, now: float) -> StateEvent:
        return replace(super().state(now), state=EngineState.CALIBRATING)

    def again(self) -> BeginCalibration:
        """Return the command that would reopen the source with the views collected so far."""
        collector = self._collector
        return replace(self._command, views=collector.views, automatic=collector.automatic)

    def change(self, command: ChangeCalibration) -> tuple[str, ...]:
        """Apply the change; see ``ChangeCalibration``.

        Raises:
            NotNow: there is nothing to undo or remove, or the board is not seen by both cameras.
        """
        collector = self._collector
        try:
            # Steps that may be refused go first, so that a refusal changes nothing else.
            if command.capture:
                time = 0.0 if self._newest is None else self._newest.time
                self._tell_captured(collector.capture(time))
            if command.undo:
                if collector.undo() is None:
                    raise NotNow("there is no view to undo; capture one first")
                self._tell_views()
            if command.remove is not None:
                collector.remove(command.remove)
                self._tell_views()
        except InputError as error:
            raise NotNow(str(error)) from error
        if command.automatic is not None:
            collector.automatic = command.automatic
        if command.cover_check is not None:
            (self._cover.ask if command.cover_check else self._cover.end)()
        return tuple(view.name for view in collector.views)

    def look(self, frame: StereoFrame) -> None:
        """Look for the board in one pair and pass the result to the publisher."""
        try:
            self._look_at(frame)
        except Exception as error:  # noqa: BLE001
            # An image that a detector cannot handle must not end the search.
            _log.exception("looking for the board failed")
            words = f"Board detection failed: {unexpected(error)}"
            self._publisher.send(BoardLookEvent(BoardLook(words), frame.received))

    def _look_at(self, frame: StereoFrame) -> None:
        left = detect_board(as_gray(frame.left), self.board, quick=True)
        self._publisher.beat()
        right = detect_board(as_gray(frame.right), self.board, quick=True)
        self._publisher.beat()
        skew = 0.0 if frame.right_time is None else abs(frame.right_time - frame.time)
        self._newest = frame
        look = self._collector.look(left, right, frame.time, skew_s=skew)
        self._cover.look(frame.left, frame.right)
        if look.view is not None:
            self._tell_captured(look.view)
        self._publisher.send(BoardLookEvent(self._facts(frame, look, left, right), frame.received))
        self._show(frame, look, {"left": left, "right": right})

    def _facts(
        self,
        frame: StereoFrame,
        look: Look,
        left: BoardSighting | None,
        right: BoardSighting | None,
    ) -> BoardLook:
        return BoardLook(
            frame=frame.index,
            words=look.words,
            next=look.next_words or None,
            coverage={name: round(bar, 3) for name, bar in look.coverage.bars.items()},
            missing=look.coverage.missing,
            seen=[0 if seen is None else len(seen) for seen in (left, right)],
            views=len(self._collector.views),
            enough=look.coverage.enough,
            automatic=self._collector.automatic,
            cover_asked=self._cover.asked,
            covered=self._cover.answer,
        )

    def _tell_captured(self, view: BoardView) -> None:
        frame = self._newest
        # A board was seen, so there is a frame.
        assert frame is not None
        pictures = small_picture(frame.left, view.left), small_picture(frame.right, view.right)
        self._tell_views(view, pictures)

    def _tell_views(
        self, added: BoardView | None = None, pictures: tuple[bytes, bytes] | None = None
    ) -> None:
        names = tuple(view.name for view in self._collector.views)
        self._publisher.send(BoardViewsEvent(names, added, pictures))

    def _show(
        self,
        frame: StereoFrame,
        look: Look,
        sightings: dict[str, BoardSighting | None],
    ) -> None:
        views = self._collector.views

        def draw(name: str) -> Image:
            side = "left" if name == CAMERA_NAMES[0] else "right"
            image = frame.left if side == "left" else frame.right
            kept = [seen for view in views if (seen := getattr(view, side)) is not None]
            # Draw the outline of the wanted pose in the left image only: it is defined there.
            outline = look.ghost if side == "left" else None
            return draw_board(image, self.board, sightings[side], kept, outline)

        self._publisher.show(frame, draw)
