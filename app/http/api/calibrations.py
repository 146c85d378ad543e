"""Calibrations: upload, look at, use."""

from __future__ import annotations

import asyncio
import re
from typing import Annotated

from fastapi import APIRouter, Depends, File, Form, Query, Response, UploadFile
from pydantic import Field

from app.contract.calibrating import Calibration, PlaceDepth
from app.contract.commands import MeasureDepth
from app.contract.status import Status
from app.http.api.common import NameInPath, TheServer, attachment, plain_name
from app.http.api.previews import PREVIEW_RESPONSES, preview_response
from app.http.api.refusals import refusals
from app.http.api.values import Finite, In, Name
from app.server import FieldError
from app.server.asking import ask
from app.server.calibrations.library import (
    check_by_tape,
    exported,
    find_calibration,
    find_kept_calibration,
    keep_upload,
    refine_rows,
)
from app.server.status import status
from app.storage import CalibrationRecord
from observer.calibration.formats.exporting import ExportKind
from observer.calibration.formats.known import UNIT_HELP, formats_in_words
from observer.calibration.formats.understanding import Cameras, NamedFile
from observer.camera import MAX_IMAGE_PX

router = APIRouter(prefix="/calibrations", tags=["calibrations"])

# Files: more than any calibration has; an upload of this many is refused for its number.
_MOST = 10


class CalibrationChange(In):
    name: Name


class TapeCheckStart(In):
    """A spot in the rectified left image and its tape-measured distance from the left lens."""

    u: Annotated[Finite, Field(ge=0, le=MAX_IMAGE_PX)]
    v: Annotated[Finite, Field(ge=0, le=MAX_IMAGE_PX)]
    measured_m: Annotated[Finite, Field(gt=0, le=100)]


def _listed(id: NameInPath, server: TheServer) -> CalibrationRecord:
    return find_calibration(server.storage, id)


# FastAPI runs this synchronous dependency in a thread.
Listed = Annotated[CalibrationRecord, Depends(_listed)]


@router.get("", summary="All calibrations", responses=refusals(503))
async def list_calibrations(server: TheServer) -> list[Calibration]:
    """Newest first."""
    records = await asyncio.to_thread(server.storage.list_calibrations)
    return [server.calibrating.entry(record) for record in records]


@router.post(
    "",
    status_code=201,
    summary="Upload a calibration",
    responses=refusals(422, 503, 507),
    description=(
        f"Recognised by content: {formats_in_words()}. It is stored but not used yet; uploading "
        "the same content again returns the same calibration."
    ),
)
async def post_calibration(
    file: Annotated[list[UploadFile], File(description="One file, or two that belong together.")],
    server: TheServer,
    size: Annotated[
        str | None, Form(description="For example 1280x720, if the files do not state it.")
    ] = None,
    unit: Annotated[
        str | None,
        Form(description=f"Unit of lengths, if not the format's own: {UNIT_HELP}."),
    ] = None,
    cameras: Annotated[Cameras | None, Form(description="KITTI's pair.")] = None,
) -> Calibration:
    files = [
        NamedFile(plain_name(each, "calibration.yaml"), await each.read()) for each in file[:_MOST]
    ]
    record = await asyncio.to_thread(
        keep_upload, server.storage, files, size=_size(size), unit=unit, cameras=cameras
    )
    return server.calibrating.entry(record)


@router.post(
    "/deactivate",
    summary="Return to the source's own calibration",
    responses=refusals(409, 422, 503),
)
async def deactivate(server: TheServer) -> Status:
    await server.calibrating.activate(None)
    return status(server)


@router.post(
    "/refine",
    status_code=201,
    summary="Refine the calibration in use from the scene",
    responses=refusals(409, 503, 507),
)
async def refine(server: TheServer) -> Calibration:
    """Saves a new calibration with corrected pitch, roll and drifted vergence.

    Nothing is replaced.
    """
    active = server.source.wanted.calibration
    record = await refine_rows(server.engine, server.storage, active)
    return server.calibrating.entry(record)


@router.patch(
    "/{id}",
    summary="Rename a calibration",
    responses=refusals(404, 422, 503),
)
async def rename(id: NameInPath, change: CalibrationChange, server: TheServer) -> Calibration:
    return server.calibrating.entry(await server.calibrating.rename(id, change.name))


@router.post("/{id}/activate", summary="Use a calibration", responses=refusals(404, 409, 422, 503))
async def activate(id: NameInPath, server: TheServer) -> Status:
    """Restarts the open source with it. Refused if the image size differs."""
    await server.calibrating.activate(id)
    return status(server)


@router.get(
    "/{id}/file",
    summary="The file as uploaded, or as used by a run",
    response_class=Response,
    responses={200: {"content": {"application/octet-stream": {}}}, **refusals(404, 503)},
)
async def get_file(id: NameInPath, server: TheServer) -> Response:
    record = await asyncio.to_thread(find_kept_calibration, server.storage, id)
    # Not served as YAML: OpenCV's first line, %YAML:1.0, is not valid YAML.
    name = f"calibration-{record.id[:12]}.yaml"
    return attachment(record.text, name, "application/octet-stream")


@router.get(
    "/{id}/export/{kind}",
    summary="The calibration in the format of another tool",
    response_class=Response,
    responses={200: {"content": {"application/octet-stream": {}}}, **refusals(404, 503)},
)
async def get_export(id: NameInPath, kind: ExportKind, server: TheServer) -> Response:
    """``opencv`` and ``kalibr`` are one file, ``ros`` a ZIP archive of left.yaml and right.yaml."""
    record = await asyncio.to_thread(find_kept_calibration, server.storage, id)
    file = await asyncio.to_thread(exported, record, kind)
    return attachment(file.content, file.name, "application/octet-stream")


@router.get(
    "/{id}/preview",
    summary="The newest image pair, rectified with a calibration",
    response_class=Response,
    responses=PREVIEW_RESPONSES,
)
async def get_preview(record: Listed, server: TheServer) -> Response:
    """Both images with the same horizontal lines: a point must lie on the same line in both."""
    return await preview_response(server, record.text)


@router.get(
    "/{id}/depth",
    summary="Distance of a spot in the newest image pair according to a calibration",
    responses=refusals(404, 409, 422, 503),
)
async def get_depth(
    record: Listed,
    server: TheServer,
    u: Annotated[float, Query(ge=0, le=MAX_IMAGE_PX, allow_inf_nan=False)],
    v: Annotated[float, Query(ge=0, le=MAX_IMAGE_PX, allow_inf_nan=False)],
) -> PlaceDepth:
    """``u``, ``v`` are pixels of the rectified left image, as the preview shows it."""
    return await ask(server.engine, MeasureDepth(record.text, u, v), field=("query", "u"))


@router.post(
    "/{id}/tape-checks",
    status_code=201,
    summary="Compare the depth of a spot with a tape measure",
    responses=refusals(404, 409, 422, 503, 507),
)
async def post_tape_check(record: Listed, check: TapeCheckStart, server: TheServer) -> Calibration:
    """Stores the result with the calibration."""
    checked = await check_by_tape(
        server.engine, server.storage, record, check.u, check.v, check.measured_m
    )
    return server.calibrating.entry(checked)


@router.delete(
    "/{id}",
    status_code=204,
    summary="Delete a calibration",
    responses=refusals(404, 409, 503),
)
async def delete_calibration(id: NameInPath, server: TheServer) -> None:
    """Runs that used it can still be repeated."""
    await server.calibrating.delete(id)


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None or not text.strip():
        return None
    found = re.fullmatch(r"\s*(\d{1,5})\s*[x×]\s*(\d{1,5})\s*", text, re.ASCII)
    if found is None:
        raise FieldError(("body", "size"), "give a size as WIDTHxHEIGHT, for example 1280x720")
    return int(found.group(1)), int(found.group(2))
