"""Making a calibration: show a board to the cameras, compute, look at it, save it."""

from __future__ import annotations

import asyncio
import shutil
import tempfile
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal

from fastapi import APIRouter, File, Form, Path, Response, UploadFile

from app.http.api.calibration_models import (
    BoardKind,
    CalibratingChange,
    CalibratingStart,
    CalibratingStatus,
    Calibration,
    CalibrationResult,
    CalibrationSave,
    ComputeStart,
)
from app.http.api.common import TheStation
from app.http.api.models import Status
from app.http.api.previews import PREVIEW_RESPONSES, preview_response
from app.http.api.refusals import refusals
from app.messages import ChangeCalibration
from app.server import FieldError, Station
from app.server.calibrating.library import preview_text
from app.server.calibrating.session import board_of
from app.server.status import status
from app.storage import StorageFull
from app.workers.calibration.image_archive import check_archive
from app.workers.calibration.messages import FindBoards
from observer.errors import CalibrationError

router = APIRouter(prefix="/calibrating", tags=["calibrating"])

ViewName = Annotated[str, Path(max_length=200)]


def _facts(station: Station) -> dict[str, Any]:
    return {"calibrating": station.calibrating.facts()}


@router.get("", response_model=CalibratingStatus, summary="How far the calibration is")
async def get_calibrating(station: TheStation) -> dict[str, Any]:
    return _facts(station)


@router.post(
    "",
    status_code=201,
    response_model=CalibratingStatus,
    summary="Look for a board in a source's images",
    responses=refusals(409, 415, 422, 503),
)
async def begin(start: CalibratingStart, station: TheStation) -> dict[str, Any]:
    """Replaces what was being calibrated; observing pauses meanwhile."""
    board = board_of(start.kind, start.columns, start.rows, start.square_mm)
    await station.begin_calibration(start.source, board)
    return _facts(station)


@router.delete(
    "", response_model=Status, summary="Leave without saving", responses=refusals(409, 503)
)
async def leave(station: TheStation) -> dict[str, Any]:
    """What was captured is forgotten; what was open before is observed again."""
    await station.end_calibration()
    return status(station)


@router.patch(
    "",
    response_model=CalibratingStatus,
    summary="Capture, undo, remove a view",
    responses=refusals(404, 409, 415, 422, 503),
)
async def change(change: CalibratingChange, station: TheStation) -> dict[str, Any]:
    """What is given is done. ``cover_check`` begins or ends the question which lens is left."""
    await station.change_calibration(ChangeCalibration(**change.model_dump()))
    return _facts(station)


@router.post(
    "/swap",
    response_model=CalibratingStatus,
    summary="Take left for right",
    responses=refusals(409, 422, 503),
)
async def swap(station: TheStation) -> dict[str, Any]:
    """The cameras are opened the other way round; the views so far are kept."""
    await station.swap_cameras()
    return _facts(station)


@router.get(
    "/views/{name}/{side}.jpg",
    summary="A captured view, small",
    response_class=Response,
    responses={200: {"content": {"image/jpeg": {}}}, **refusals(404)},
)
async def get_picture(
    name: ViewName, side: Literal["left", "right"], station: TheStation
) -> Response:
    jpeg = station.calibrating.picture(name, 0 if side == "left" else 1)
    return Response(jpeg, media_type="image/jpeg")


@router.post(
    "/images",
    response_model=CalibratingStatus,
    summary="Send in image pairs as a ZIP archive",
    responses=refusals(409, 413, 415, 422, 503, 507),
)
async def post_images(
    file: Annotated[UploadFile, File(description="left/ and right/ with equal file names.")],
    kind: Annotated[BoardKind, Form()],
    columns: Annotated[int, Form(ge=3, le=30)],
    rows: Annotated[int, Form(ge=3, le=30)],
    square_mm: Annotated[float, Form(ge=2, le=500, allow_inf_nan=False)],
    station: TheStation,
) -> dict[str, Any]:
    """The board is looked for in every pair; what was captured before is forgotten only then."""
    board = board_of(kind, columns, rows, square_mm)
    with tempfile.TemporaryDirectory(prefix="dynamic-observer-") as folder:
        archive = FilePath(folder) / "images.zip"
        await asyncio.to_thread(_write, file, archive)
        try:
            await asyncio.to_thread(check_archive, archive)
            await station.calibrate_images(FindBoards(archive, board))
        except CalibrationError as error:
            raise FieldError(("body", "file"), str(error)) from error
    return _facts(station)


@router.post(
    "/compute",
    status_code=202,
    response_model=CalibratingStatus,
    summary="Compute the calibration of the captured views",
    responses=refusals(409, 415, 422),
)
async def compute(start: ComputeStart, station: TheStation) -> dict[str, Any]:
    """It goes on in the background; ``computing`` tells how far it is."""
    station.calibrating.compute(start.distortion_model)
    return _facts(station)


@router.post(
    "/cancel", response_model=CalibratingStatus, summary="End the computation", responses={}
)
async def cancel(station: TheStation) -> dict[str, Any]:
    """Views and an earlier result stay."""
    await station.calibrating.cancel()
    return _facts(station)


@router.get(
    "/result",
    response_model=CalibrationResult,
    summary="What was computed",
    responses=refusals(409),
)
async def get_result(station: TheStation) -> dict[str, Any]:
    result = station.calibrating.finished
    return {"views": list(result.names), "report": result.fitted.report}


@router.get(
    "/preview",
    summary="The newest pair rectified with what was computed",
    response_class=Response,
    responses=PREVIEW_RESPONSES,
)
async def get_preview(station: TheStation) -> Response:
    """Both images with the same horizontal lines: a point must lie on the same line in both."""
    text = station.calibrating.finished.fitted.calibration_yaml
    return preview_response(await preview_text(station.engine, text))


@router.post(
    "/save",
    status_code=201,
    response_model=Calibration,
    summary="Save what was computed",
    responses=refusals(409, 415, 422, 503, 507),
)
async def save(save: CalibrationSave, station: TheStation) -> dict[str, Any]:
    """``activate`` observes its cameras with it from now on, and ends calibrating."""
    from app.http.api.calibrations import entry

    return entry(await station.save_calibration(save.name, activate=save.activate), station)


def _write(file: UploadFile, path: FilePath) -> None:
    try:
        with path.open("wb") as out:
            shutil.copyfileobj(file.file, out, 1 << 20)
    except OSError as error:
        raise StorageFull(
            f"the images cannot be unpacked in {path.parent.parent}: {error.strerror}; free some "
            f"disk space"
        ) from error
