"""The calibration in progress: the board, the cameras, the views so far.

The engine finds the boards and reports them; the captured views are kept here, so that they survive
the loss of an engine. Everything runs in the event loop.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from app.contract.answers import Opened
from app.contract.calibrating import (
    BoardFacts,
    BoardLook,
    CalibratingFacts,
    CapturedView,
    Computing,
)
from app.contract.commands import BeginCalibration, ChangeCalibration
from app.contract.events import BoardLookEvent, BoardViewsEvent
from app.contract.values import filled
from app.server.asking import ask
from app.server.calibrating.computation import Computation
from app.server.errors import Conflict, FieldError, NotThere
from app.server.shared import Shared
from app.workers.calibration.messages import BoardsFound, FitViews
from observer.calibration.boards.board import Board, BoardKind, BoardView
from observer.camera import DistortionModel
from observer.errors import CalibrationError, SourceError
from observer.sources.cameras.spec import swapped_spec

# Assumed if the images do not show the frame rate.
_USUAL_RATE = 15.0


@dataclass(frozen=True)
class KeptView:
    """Captured view, with a small JPEG of each image if there is one."""

    view: BoardView
    pictures: tuple[bytes, bytes] | None


@dataclass(frozen=True)
class CalibratedCameras:
    """Cameras that a calibration belongs to.

    Attributes:
        source: the text that opens them, without passwords.
        devices: as in ``SourceInfo.devices``. settings: settings of each camera, text by name.
    """

    source: str | None
    devices: tuple[str, ...]
    settings: tuple[Mapping[str, str], ...]


class CalibrationSession:
    """State of one calibration; the caller ensures one calibration and one change at a time.

    Attributes:
        source: what is being calibrated; None for uploaded images, or if there is no calibration.
        board: the board to find; None if there is no calibration.
        cameras: cameras that a result belongs to. computation: fit of the views.
    """

    def __init__(self, shared: Shared) -> None:
        """Start without a calibration; followers are notified whenever ``facts`` change."""
        self._shared = shared
        self._changed = shared.followers.status_changed
        self.computation = Computation(self._changed)
        self._clear()

    def _clear(self) -> None:
        self.source: str | None = None
        self.board: Board | None = None
        self.automatic = True
        self._size: tuple[int, int] | None = None
        self._frame_rate = _USUAL_RATE
        self._views: dict[str, KeptView] = {}
        self._look: BoardLook | None = None
        self._refused: tuple[str, ...] = ()
        self.cameras = CalibratedCameras(None, (), ())
        self.computation.clear()

    # --- starting and ending -----------------------------------------------------------------

    @property
    def open(self) -> bool:
        """Return whether a calibration is in progress."""
        return self.board is not None

    async def begin(self, source: str, board: Board) -> None:
        """Look for the board in the images of a source.

        Raises:
            FieldError: the source cannot be opened; the previous one stays open.
            NotAvailable: there is no engine at the moment.
        """
        facts = await self._ask_to_begin(source, board, {})
        await self.end()
        self.source, self.board = source, board
        self._note_source(facts)
        self._changed()

    async def swap(self) -> None:
        """Swap left and right, in the views captured so far as well.

        Raises:
            Conflict: no live cameras are being calibrated. FieldError: they cannot be opened again.
        """
        board = self._open_board()
        try:
            source = swapped_spec(self.source or "")
        except SourceError as error:
            raise Conflict(str(error)) from error
        views = {name: _swapped(kept) for name, kept in self._views.items()}
        facts = await self._ask_to_begin(source, board, views)
        # The result was for the cameras in the other order.
        await self.computation.cancel()
        self.computation.result = None
        self.source, self._views = source, views
        self._note_source(facts)
        self._changed()

    async def resume(self) -> None:
        """Continue with a new engine where the lost one stopped; do nothing for uploaded images."""
        if self.source is None or self.board is None:
            return
        self._note_source(await self._ask_to_begin(self.source, self.board, self._views))

    async def _ask_to_begin(
        self, source: str, board: Board, kept: Mapping[str, KeptView]
    ) -> Opened:
        views = tuple(each.view for each in kept.values())
        command = BeginCalibration(source, board, views, self.automatic)
        return await self._shared.open_in_engine(command)

    def _note_source(self, opened: Opened) -> None:
        info, live = opened.state.source, opened.state.live
        assert info is not None
        self._size = (info.width, info.height)
        self._frame_rate = info.frame_rate
        cameras = () if live is None else live.cameras
        settings = tuple(dict(camera.settings) for camera in cameras)
        self.cameras = CalibratedCameras(info.spec, info.devices, settings)

    async def end(self) -> None:
        """Discard everything; safe to call without a calibration."""
        await self.computation.cancel()
        self._clear()
        self._changed()

    # --- views -------------------------------------------------------------------------------

    async def change(self, command: ChangeCalibration) -> None:
        """Capture, undo, remove, or find the covered lens; see ``ChangeCalibration``.

        Raises:
            Conflict: no calibration is in progress, or there is nothing to capture or undo.
            NotThere: there is no view with the name to remove.
        """
        self._open_board()
        if command.remove is not None and command.remove not in self._views:
            raise NotThere(f"there is no view {command.remove[:80]!r}")
        if self.source is not None:
            await ask(self._shared.engine, command)
            if command.automatic is not None:
                self.automatic = command.automatic
        elif command.remove is not None:
            del self._views[command.remove]
        else:
            raise Conflict(
                "this calibration uses uploaded images; start one with cameras to capture views"
            )
        self._changed()

    def looked(self, event: BoardLookEvent) -> None:
        """Take the engine's result for an image pair."""
        if self.open:
            self._look = event.look
            self._changed()

    def views_changed(self, event: BoardViewsEvent) -> None:
        """Take the engine's message that it captured or removed a view."""
        if not self.open:
            return
        if event.added is not None:
            self._views[event.added.name] = KeptView(event.added, event.pictures)
        self._views = {name: self._views[name] for name in event.names if name in self._views}
        self._changed()

    def picture(self, name: str, side: int) -> bytes:
        """Return a view's thumbnail; ``side`` 0 is left.

        Raises:
            NotThere: there is no such view, or it has no thumbnail.
        """
        kept = self._views.get(name)
        if kept is None or kept.pictures is None:
            raise NotThere(f"there is no image of a view {name[:80]!r}")
        return kept.pictures[side]

    async def take_images(self, found: BoardsFound, board: Board) -> None:
        """Continue with the boards found in images; discard earlier views."""
        await self.end()
        self.board = board
        self._size = (found.width, found.height)
        self._refused = found.refused
        pictures = iter(found.pictures)
        self._views = {view.name: KeptView(view, next(pictures)) for view in found.views}
        self._changed()

    # --- computing ---------------------------------------------------------------------------

    def compute(self, distortion_model: DistortionModel) -> None:
        """Start to compute a calibration from the views; ``facts`` report the progress.

        Raises:
            Conflict: no calibration is in progress, there are no views, or it is already being
                computed.
        """
        board = self._open_board()
        self.computation.refuse_going()
        if not self._views or self._size is None:
            raise Conflict("there are no views yet; show the board to both cameras first")
        views = tuple(kept.view for kept in self._views.values())
        self.computation.fit(
            FitViews(views, board, *self._size, self._frame_rate, distortion_model)
        )

    # --- display -----------------------------------------------------------------------------

    def facts(self) -> CalibratingFacts | None:
        """Return all that the page shows except the result; None without a calibration."""
        board = self.board
        if board is None:
            return None
        progress, result = self.computation.progress, self.computation.result
        return CalibratingFacts(
            source=self.cameras.source,
            board=filled(BoardFacts, board, square_mm=round(1e3 * board.square_m, 4)),
            size=self._size,
            automatic=self.automatic,
            look=self._look,
            views=[_view_facts(kept) for kept in self._views.values()],
            refused=list(self._refused),
            computing=None
            if progress is None
            else Computing(progress.words, round(progress.share, 3)),
            trouble=self.computation.trouble,
            result=None if result is None else list(result.names),
        )

    def _open_board(self) -> Board:
        if self.board is None:
            raise Conflict("no calibration is in progress; start one first")
        return self.board


def board_of(kind: BoardKind, columns: int, rows: int, square_mm: float) -> Board:
    """Return the board that a request names.

    Raises:
        FieldError: there is no such board.
    """
    try:
        return Board(kind, columns, rows, square_mm / 1e3)
    except CalibrationError as error:
        raise FieldError(("body", "board"), str(error)) from error


def _swapped(kept: KeptView) -> KeptView:
    view, pictures = kept.view, kept.pictures
    return KeptView(
        BoardView(view.name, view.right, view.left),
        None if pictures is None else (pictures[1], pictures[0]),
    )


def _view_facts(kept: KeptView) -> CapturedView:
    view = kept.view
    return CapturedView(
        name=view.name,
        left=0 if view.left is None else len(view.left),
        right=0 if view.right is None else len(view.right),
        picture=kept.pictures is not None,
    )
