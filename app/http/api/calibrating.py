"""Making a calibration: show a board to the cameras, compute, look at it, save it."""

from __future__ import annotations

import asyncio
import shutil
import tempfile
from pathlib import Path as FilePath
from typing import Annotated, Literal

from fastapi import APIRouter, File, Form, Path, Response, UploadFile
from pydantic import Field, StrictBool

from app.contract.calibrating import CalibratingStatus, Calibration, CalibrationResult
from app.contract.commands import ChangeCalibration
from app.contract.status import Status
from app.http.api.common import TheServer
from app.http.api.previews import PREVIEW_RESPONSES, preview_response
from app.http.api.refusals import refusals
from app.http.api.values import Corners, In, Name, Spec, SquareMm
from app.server import FieldError, Server
from app.server.calibrating.session import board_of
from app.server.status import status
from app.storage import StorageFull
from observer.calibration.boards.board import A4_COLUMNS, A4_ROWS, A4_SQUARE_MM, BoardKind
from observer.camera import DistortionModel
from observer.errors import CalibrationError

router = APIRouter(prefix="/calibrating", tags=["calibrating"])

ViewName = Annotated[str, Path(max_length=200)]


class CalibratingStart(In):
    """The board is named by its inner corners, as OpenCV names it."""

    source: Spec | None = Field(None, description="null: the open source.")
    kind: BoardKind = "chessboard"
    columns: Annotated[Corners, Field(strict=True)] = A4_COLUMNS
    rows: Annotated[Corners, Field(strict=True)] = A4_ROWS
    square_mm: Annotated[SquareMm, Field(strict=True)] = A4_SQUARE_MM


class CalibratingChange(In):
    """Applies the given fields."""

    capture: StrictBool = False
    undo: StrictBool = False
    remove: Annotated[str, Field(strict=True, max_length=200)] | None = None
    automatic: StrictBool | None = Field(None, description="Capture new poses automatically.")
    cover_check: StrictBool | None = None


class ComputeStart(In):
    distortion_model: DistortionModel = Field(
        "radtan", description="equidistant is for fisheye lenses."
    )


class CalibrationSave(In):
    name: Name
    activate: StrictBool = True


def _facts(server: Server) -> CalibratingStatus:
    return CalibratingStatus(server.calibrating.session.facts())


@router.get("", summary="Progress of the calibration")
async def get_calibrating(server: TheServer) -> CalibratingStatus:
    return _facts(server)


@router.post(
    "",
    status_code=201,
    summary="Detect a board in the images of a source",
    responses=refusals(409, 422, 503),
)
async def begin(start: CalibratingStart, server: TheServer) -> CalibratingStatus:
    """Replaces any calibration in progress; observing pauses meanwhile."""
    board = board_of(start.kind, start.columns, start.rows, start.square_mm)
    await server.calibrating.begin(start.source, board)
    return _facts(server)


@router.delete("", summary="Leave without saving", responses=refusals(409, 503))
async def leave(server: TheServer) -> Status:
    """Drops the captured views and observes the previous source again."""
    await server.calibrating.end()
    return status(server)


@router.patch("", summary="Capture, undo, remove a view", responses=refusals(404, 409, 422, 503))
async def change(change: CalibratingChange, server: TheServer) -> CalibratingStatus:
    """Applies the given fields. ``cover_check`` starts or ends the check of which lens is left."""
    await server.calibrating.change(ChangeCalibration(**change.model_dump()))
    return _facts(server)


@router.post("/swap", summary="Swap left and right", responses=refusals(409, 422, 503))
async def swap(server: TheServer) -> CalibratingStatus:
    """Opens the cameras the other way round; the captured views are kept."""
    await server.calibrating.swap()
    return _facts(server)


@router.get(
    "/views/{name}/{side}.jpg",
    summary="Thumbnail of a captured view",
    response_class=Response,
    responses={200: {"content": {"image/jpeg": {}}}, **refusals(404)},
)
async def get_picture(
    name: ViewName, side: Literal["left", "right"], server: TheServer
) -> Response:
    jpeg = server.calibrating.session.picture(name, 0 if side == "left" else 1)
    return Response(jpeg, media_type="image/jpeg")


@router.post(
    "/images",
    summary="Upload image pairs as a ZIP archive",
    responses=refusals(409, 422, 503, 507),
)
async def post_images(
    file: Annotated[UploadFile, File(description="left/ and right/ with the same file names.")],
    kind: Annotated[BoardKind, Form()],
    columns: Annotated[Corners, Form()],
    rows: Annotated[Corners, Form()],
    square_mm: Annotated[SquareMm, Form()],
    server: TheServer,
) -> CalibratingStatus:
    """Detects the board in every pair; only then are earlier captures discarded."""
    board = board_of(kind, columns, rows, square_mm)
    with tempfile.TemporaryDirectory(prefix="dynamic-observer-") as folder:
        archive = FilePath(folder) / "images.zip"
        await asyncio.to_thread(_write, file, archive)
        try:
            await server.calibrating.take_images(archive, board)
        except CalibrationError as error:
            raise FieldError(("body", "file"), str(error)) from error
    return _facts(server)


@router.post(
    "/compute",
    status_code=202,
    summary="Compute the calibration of the captured views",
    responses=refusals(409, 422),
)
async def compute(start: ComputeStart, server: TheServer) -> CalibratingStatus:
    """Runs in the background; ``computing`` reports the progress."""
    server.calibrating.session.compute(start.distortion_model)
    return _facts(server)


@router.post("/cancel", summary="Cancel the computation", responses={})
async def cancel(server: TheServer) -> CalibratingStatus:
    """Keeps the views and an earlier result."""
    await server.calibrating.session.computation.cancel()
    return _facts(server)


@router.get("/result", summary="The computed calibration", responses=refusals(409))
async def get_result(server: TheServer) -> CalibrationResult:
    result = server.calibrating.session.computation.finished
    return CalibrationResult(result.names, result.fitted.report)


@router.get(
    "/preview",
    summary="The newest image pair, rectified with the computed calibration",
    response_class=Response,
    responses=PREVIEW_RESPONSES,
)
async def get_preview(server: TheServer) -> Response:
    """Both images with the same horizontal lines: a point must lie on the same line in both."""
    text = server.calibrating.session.computation.finished.fitted.calibration_yaml
    return await preview_response(server, text)


@router.post(
    "/save",
    status_code=201,
    summary="Save the computed calibration",
    responses=refusals(409, 422, 503, 507),
)
async def save(save: CalibrationSave, server: TheServer) -> Calibration:
    """With ``activate``, the cameras are observed with it from now on, and calibrating ends."""
    saved = await server.calibrating.save(save.name, activate=save.activate)
    return server.calibrating.entry(saved)


def _write(file: UploadFile, path: FilePath) -> None:
    try:
        with path.open("wb") as out:
            shutil.copyfileobj(file.file, out, 1 << 20)
    except OSError as error:
        raise StorageFull(
            f"the images cannot be unpacked in {path.parent.parent}: {error.strerror}; free some "
            f"disk space"
        ) from error
