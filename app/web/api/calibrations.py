"""Calibrations: upload, look at, use."""

from __future__ import annotations

import asyncio
from functools import partial
from typing import Annotated, Any

from fastapi import APIRouter, File, Path, Response, UploadFile

from app.station import Station
from app.station.calibrations import (
    find_calibration,
    find_kept_calibration,
    keep_upload,
    preview_calibration,
)
from app.station.status import status
from app.storage import CalibrationRecord
from app.web.api.common import TheStation, refusals
from app.web.api.models import Calibration, Status

router = APIRouter(prefix="/calibrations", tags=["calibrations"])

CalibrationId = Annotated[str, Path(max_length=100)]
_LONGEST_NAME = 100


def _entry(record: CalibrationRecord, station: Station) -> dict[str, Any]:
    active = station.wanted.calibration
    return {
        "id": record.id,
        "name": record.name,
        "created_at": record.created_at,
        "active": active is not None and active.id == record.id,
        **record.info,
    }


@router.get(
    "", response_model=list[Calibration], summary="All calibrations", responses=refusals(503)
)
async def list_calibrations(station: TheStation) -> list[dict[str, Any]]:
    """Newest first."""
    records = await asyncio.to_thread(station.storage.list_calibrations)
    return [_entry(record, station) for record in records]


@router.post(
    "",
    status_code=201,
    response_model=Calibration,
    summary="Upload a calibration",
    responses=refusals(413, 415, 422, 503, 507),
)
async def post_calibration(
    file: Annotated[UploadFile, File(description="OpenCV FileStorage, YAML; lengths in metres.")],
    station: TheStation,
) -> dict[str, Any]:
    """It is kept, not used yet. The same content is the same calibration."""
    content = await file.read()
    name = _plain_name(file.filename)
    record = await asyncio.to_thread(partial(keep_upload, station.storage, content, name))
    return _entry(record, station)


@router.post(
    "/deactivate",
    response_model=Status,
    summary="Go back to the source's own calibration",
    responses=refusals(409, 422, 503),
)
async def deactivate(station: TheStation) -> dict[str, Any]:
    await station.activate_calibration(None)
    return status(station)


@router.post(
    "/{id}/activate",
    response_model=Status,
    summary="Use a calibration",
    responses=refusals(404, 409, 422, 503),
)
async def activate(id: CalibrationId, station: TheStation) -> dict[str, Any]:
    """The open source begins again with it. Refused where the image size differs."""
    await station.activate_calibration(id)
    return status(station)


@router.get(
    "/{id}/file",
    summary="The file as it was uploaded, or as a run used it",
    response_class=Response,
    responses={200: {"content": {"application/yaml": {}}}, **refusals(404, 503)},
)
async def get_file(id: CalibrationId, station: TheStation) -> Response:
    record = await asyncio.to_thread(find_kept_calibration, station.storage, id)
    headers = {"Content-Disposition": f'attachment; filename="calibration-{record.id[:12]}.yaml"'}
    return Response(record.text, media_type="application/yaml", headers=headers)


@router.get(
    "/{id}/preview",
    summary="The newest pair rectified with a calibration",
    response_class=Response,
    responses={
        200: {
            "content": {"image/jpeg": {}},
            "headers": {
                "X-Vertical-Error-Px": {
                    "description": "Median vertical distance of matching points; absent where "
                    "there were too few.",
                    "schema": {"type": "number"},
                },
                "X-Matches": {"schema": {"type": "integer"}},
            },
        },
        **refusals(404, 409, 422, 503),
    },
)
async def get_preview(id: CalibrationId, station: TheStation) -> Response:
    """Both images with the same horizontal lines: a point must lie on the same line in both."""
    record = await asyncio.to_thread(find_calibration, station.storage, id)
    preview = await preview_calibration(station.engine, record)
    headers = {"X-Matches": str(preview["matches"])}
    if preview["vertical_error_px"] is not None:
        headers["X-Vertical-Error-Px"] = f"{preview['vertical_error_px']:.3f}"
    return Response(preview["jpeg"], media_type="image/jpeg", headers=headers)


@router.delete(
    "/{id}",
    status_code=204,
    summary="Take a calibration off the list",
    responses=refusals(404, 409, 503),
)
async def delete_calibration(id: CalibrationId, station: TheStation) -> None:
    """Runs that used it stay repeatable."""
    await station.delete_calibration(id)


def _plain_name(name: str | None) -> str:
    """A file's name without its folders and without what is no text."""
    last = (name or "").replace("\\", "/").rpartition("/")[2]
    plain = "".join(c for c in last if c.isprintable())[:_LONGEST_NAME]
    return plain or "calibration.yaml"
