"""The worker as a process: results, refusals, and what ends it."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import psutil
import pytest
from scipy.spatial.transform import Rotation

from app.runtime import worker as worker_module
from app.runtime.errors import ChannelError
from app.runtime.jobs import Progress, Refused, answer
from app.workers.calibration.messages import (
    BoardsFound,
    FindBoards,
    Fitted,
    FitViews,
    Job,
    RefineRows,
)
from app.workers.calibration.process import work
from app.workers.calibration.work import do_job
from observer.calibration.boards.board import Board, BoardSighting, BoardView
from observer.calibration.formats.opencv_file import calibration_text, read_calibration
from observer.camera import StereoCalibration
from observer.errors import CalibrationError

BOARD = Board("chessboard", 9, 6, 0.025)
SIZE = (640, 480)
FOCAL, BASELINE = 520.0, 0.1
K = np.array([[FOCAL, 0, 319.5], [0, FOCAL, 239.5], [0, 0, 1]])
TILTS = [(0, 0), (30, 0), (-30, 0), (0, 30), (0, -30), (20, 25), (-25, 20), (25, -20), (10, 5)]


def poses() -> list[tuple[np.ndarray, np.ndarray]]:
    """Return rotation and position of the board's corner 0 in the left camera's frame."""
    found = []
    for number, tilt in enumerate(TILTS):
        R = Rotation.from_euler("xyz", [*tilt, 8 * number - 32], degrees=True).as_matrix()
        middle = R @ BOARD.object_points.mean(axis=0)
        place = [0.07 * ((number % 3) - 1) + 0.05, 0.04 * (number // 3 - 1), 0.5 + 0.02 * number]
        found.append((R, np.array(place) - middle))
    return found


def views() -> tuple[BoardView, ...]:
    """Return views by two ideal cameras; corners with a little noise."""
    rng = np.random.default_rng(0)

    def seen(R: np.ndarray, t: np.ndarray) -> BoardSighting:
        points = (BOARD.object_points @ R.T + t) @ K.T
        px = points[:, :2] / points[:, 2:] + rng.normal(0, 0.1, (len(points), 2))
        return BoardSighting(np.arange(len(px), dtype=np.int32), px)

    return tuple(
        BoardView(str(k), seen(R, t), seen(R, t - [BASELINE, 0, 0]))
        for k, (R, t) in enumerate(poses(), 1)
    )


def picture(R: np.ndarray, t: np.ndarray, px_per_square: int = 40) -> bytes:
    squares = np.where(np.add.outer(np.arange(9), np.arange(12)) % 2 == 0, 20, 235).astype(np.uint8)
    squares[[0, -1]] = squares[:, [0, -1]] = 235
    drawn = np.asarray(np.kron(squares, np.ones((px_per_square,) * 2, np.uint8)), np.uint8)
    step = BOARD.square_m / px_per_square
    first = -step * (2 * px_per_square - 0.5)
    to_board = np.array([[step, 0, first], [0, step, first], [0, 0, 1]])
    larger = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1]])
    H = larger @ K @ np.column_stack([R[:, 0], R[:, 1], t]) @ to_board
    image = cv2.warpPerspective(drawn, H, (2 * SIZE[0], 2 * SIZE[1]), borderValue=128)
    image = cv2.resize(image, SIZE, interpolation=cv2.INTER_AREA)
    return cv2.imencode(".png", image)[1].tobytes()


def archive_of(path: Path, entries: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in entries.items():
            archive.writestr(name, content)
    return path


def large_png(width: int, height: int) -> bytes:
    """Return a few kilobytes that expand to a hundred megabytes of pixels and more."""
    content = bytearray(cv2.imencode(".png", np.zeros((1, 1), np.uint8))[1].tobytes())
    head = width.to_bytes(4, "big") + height.to_bytes(4, "big") + bytes([8, 0, 0, 0, 0])
    content[16:29] = head
    content[29:33] = zlib.crc32(b"IHDR" + head).to_bytes(4, "big")
    return bytes(content)


# --- results --------------------------------------------------------------------------------


async def test_views_become_a_calibration_with_its_report() -> None:
    heard: list[Progress] = []
    job = FitViews(views(), BOARD, *SIZE, 30.0)
    fitted = await work(job, heard.append)
    assert isinstance(fitted, Fitted)
    calibration = read_calibration(fitted.calibration_yaml, name="it")
    assert calibration.baseline == pytest.approx(BASELINE, rel=0.01)
    assert calibration.K1[0, 0] == pytest.approx(FOCAL, rel=0.01)
    assert fitted.report["verdict"]
    assert heard
    shares = [each.share for each in heard]
    assert shares == sorted(shares)
    assert 0 <= shares[0] <= shares[-1] <= 1


async def test_boards_are_found_in_an_archive(tmp_path: Path) -> None:
    entries = {}
    for k, (R, t) in enumerate(poses()[:4]):
        entries[f"left/{k}.png"] = picture(R, t)
        entries[f"right/{k}.png"] = picture(R, t - [BASELINE, 0, 0])
    # Larger than any camera's image, no image at all, and an image of another size.
    entries["left/huge.png"] = large_png(60_000, 60_000)
    entries["right/huge.png"] = entries["right/0.png"]
    entries["left/none.png"] = entries["right/none.png"] = b"no image"
    small = cv2.imencode(".png", np.zeros((60, 80), np.uint8))[1].tobytes()
    entries["left/small.png"] = entries["right/small.png"] = small
    heard: list[Progress] = []
    found = await work(FindBoards(archive_of(tmp_path / "a.zip", entries), BOARD), heard.append)
    assert isinstance(found, BoardsFound)
    assert [view.name for view in found.views] == ["0", "1", "2", "3"]
    assert (found.width, found.height) == SIZE
    for (R, t), view in zip(poses(), found.views, strict=False):
        points = (BOARD.object_points @ R.T + t) @ K.T
        assert view.left is not None
        truth = points[:, :2] / points[:, 2:]
        assert np.abs(view.left.px - truth).max() < 0.3
    assert all(each.startswith(b"\xff\xd8") for pair in found.pictures for each in pair)
    assert {reason.split(":")[0] for reason in found.refused} == {"huge", "none", "small"}
    assert len(heard) >= 7


async def test_an_impossible_job_is_refused_with_a_reason(tmp_path: Path) -> None:
    R, t = poses()[0]
    other = archive_of(
        tmp_path / "a.zip",
        {"left1.png": picture(R, t), "right1.png": picture(R, t - [BASELINE, 0, 0])},
    )
    jobs: dict[str, Job] = {
        "there are no images for the refinement yet": RefineRows(
            calibration_text(StereoCalibration.rectified(*SIZE, 500, 500, 320, 240, 0.1)), "x", ()
        ),
        "shows one of 9x6": FindBoards(other, Board("chessboard", 8, 5, 0.025)),
        "is not a ZIP archive": FindBoards(tmp_path / "missing.zip", BOARD),
    }

    for words, job in jobs.items():
        messages: list[Any] = []
        answer(do_job, job, messages.append)
        assert isinstance(messages[-1], Refused)
        assert words in messages[-1].reason
        assert not any(isinstance(each, Refused) for each in messages[:-1])
    with pytest.raises(CalibrationError, match="is not a ZIP archive"):
        await work(FindBoards(tmp_path / "missing.zip", BOARD), lambda _: None)


# --- ends -----------------------------------------------------------------------------------


async def test_a_dying_worker_is_reported() -> None:
    doing = asyncio.create_task(work(endless(), lambda _: None))
    (await worker()).kill()
    with pytest.raises(
        CalibrationError, match="the computation ended by SIGKILL without a result; start it again"
    ):
        await doing


async def test_a_crashing_worker_is_reported_without_its_traceback(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(
        CalibrationError, match="the computation ended with exit code 1 without a result"
    ):
        await work("no job", lambda _: None)  # type: ignore[arg-type]
    # Its own words are in the log, not in the answer.
    assert "Traceback" in capfd.readouterr().err


async def test_cancelling_ends_the_worker() -> None:
    doing = asyncio.create_task(work(endless(), lambda _: None))
    process = await worker()
    doing.cancel()
    with pytest.raises(asyncio.CancelledError):
        await doing
    assert not process.is_running() or process.status() == psutil.STATUS_ZOMBIE


async def test_a_worker_ends_with_its_server(repository: Path, tmp_path: Path) -> None:
    code = (
        "import asyncio, sys\n"
        "from app.workers.calibration.process import work\n"
        "from app.workers.calibration.messages import FindBoards\n"
        "from observer.calibration.boards.board import Board\n"
        "from pathlib import Path\n"
        "asyncio.run(work(FindBoards(Path(sys.argv[1]), Board()), lambda _: None))\n"
    )
    # Reading a pipe without a writer never ends.
    fifo = tmp_path / "images.zip"
    os.mkfifo(fifo)
    server = subprocess.Popen([sys.executable, "-c", code, str(fifo)], cwd=repository)
    try:
        started = await _child_of(psutil.Process(server.pid))
    finally:
        server.kill()
        server.wait(10)
    _, alive = psutil.wait_procs([started], timeout=8)
    assert alive == []


async def test_an_unsendable_job_or_unstartable_worker_is_reported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def too_large(_: object) -> bytes:
        raise ChannelError("a FitViews of 70000000 bytes exceeds the largest message")

    with monkeypatch.context() as patch:
        patch.setattr(worker_module, "encode", too_large)
        with pytest.raises(CalibrationError, match="cannot be started: a FitViews of 70000000"):
            await work(endless(), lambda _: None)
    monkeypatch.setattr(worker_module, "_COMMAND", ("/no/such/python",))
    with pytest.raises(CalibrationError, match=r"cannot be started: .*No such file"):
        await work(endless(), lambda _: None)


def endless() -> FitViews:
    return FitViews(views() * 40, BOARD, *SIZE, 30.0)


async def worker() -> psutil.Process:
    return await _child_of(psutil.Process())


async def _child_of(parent: psutil.Process) -> psutil.Process:
    while True:
        for child in parent.children(recursive=True):
            if "app.workers.calibration" in " ".join(child.cmdline()):
                return child
        await asyncio.sleep(0.02)
