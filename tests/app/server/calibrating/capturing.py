"""A server that calibrates, over the peer engine, and a stand-in for its worker."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from app.contract.commands import BeginCalibration, ChangeCalibration
from app.runtime.jobs import Progress
from app.server import Server
from app.workers.calibration.messages import BoardsFound, Fitted, FitViews
from observer.calibration.boards.board import Board, BoardView

from ....waiting import until_async

BOARD = Board("chessboard", 9, 6, 0.025)
CAMERAS = "simulated:calibration"
CAPTURE = ChangeCalibration(capture=True)


async def captured(peer: Any, server: Server, count: int = 3) -> None:
    """Begin to calibrate the cameras, with some views already captured."""
    await server.calibrating.begin(CAMERAS, BOARD)
    peer.board_seen = True
    for _ in range(count):
        await server.calibrating.change(CAPTURE)


def names(server: Server) -> list[str]:
    facts = server.calibrating.session.facts()
    assert facts is not None
    return [view.name for view in facts.views]


def begin_requests(peer: Any) -> list[BeginCalibration]:
    return [command for command in peer.commands if isinstance(command, BeginCalibration)]


class Computing:
    """Stands in for the worker: receives its jobs, and answers when it is told to."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.jobs: list[Any] = []
        self.release = asyncio.Event()
        self.fails: Exception | None = None
        self.cancelled = 0

    async def __call__(self, job: Any, progress: Callable[[Progress], None]) -> Any:
        self.jobs.append(job)
        progress(Progress("fitting both cameras", 0.5))
        try:
            await self.release.wait()
        except asyncio.CancelledError:
            self.cancelled += 1
            raise
        if self.fails is not None:
            raise self.fails
        if isinstance(job, FitViews):
            return Fitted(self.text, {"stereo_rms_px": 0.2})
        view = BoardView("a", None, None)
        return BoardsFound((view,), ((b"left", b"right"),), 640, 480, ("b: blurred",))


async def computed(peer: Any, server: Server, computing: Computing) -> None:
    """Calibrate the cameras and have a result."""
    await captured(peer, server)
    computing.release.set()
    server.calibrating.session.compute("radtan")
    await until_async(lambda: server.calibrating.session.computation.result)
