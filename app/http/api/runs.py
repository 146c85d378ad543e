"""Runs: recorded observations."""

from __future__ import annotations

import asyncio
import csv
import io
import json
from collections.abc import Sequence
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Response
from fastapi.responses import FileResponse
from pydantic import Field

from app.contract.robots import RobotIncident
from app.contract.runs import Run, SpeedEntry, StartedRun
from app.contract.values import filled
from app.http.api.common import NameInPath, TheServer, attachment
from app.http.api.programmes import ProgrammeStart, programme_command
from app.http.api.refusals import refusals
from app.http.api.values import Changes, Identifier, In, Name, Spec, Tag, Text, notes_on
from app.http.file_name import content_disposition
from app.http.stored_file import StoredFileResponse
from app.server.runs.archive import MOST_RUNS
from app.server.runs.files import file_stem
from app.storage import SpeedRow
from observer.recording.payloads import Images

router = APIRouter(prefix="/runs", tags=["runs"])

_COLUMNS = ("time", "role", "source", "track_id", "speed", "std", "segment")


class RunStart(In):
    name: Name | None = None
    source: Spec | None = Field(None, description="null: the open source.")
    calibration: Identifier | None = Field(None, description="null: the source's own.")
    preset: Name | None = None
    parameters: Changes = Field(default_factory=dict, description="Changes to the preset, if any.")
    programme: ProgrammeStart | None = Field(
        None, description="Programme that starts and ends with the run."
    )
    record: Images = Field(
        "jpeg", description="Which images are recorded; everything else is always recorded."
    )


class RunChange(In):
    """Changes the given fields."""

    name: Name | None = None
    tags: Annotated[list[Tag], Field(max_length=50)] | None = Field(
        None, description="All tags; they replace the previous ones."
    )
    notes: Text | None = None


@router.post(
    "", status_code=201, summary="Start a run", responses=refusals(404, 409, 422, 503, 507)
)
async def start_run(wanted: RunStart, server: TheServer) -> StartedRun:
    """Records from now on, from the source's beginning, with all settings.

    One run at a time. The run of a recording ends with the recording.
    """
    programme = None
    if wanted.programme is not None:
        programme = await programme_command(server, wanted.programme)
    run = await server.runs.start(
        name=wanted.name,
        source=wanted.source,
        calibration_id=wanted.calibration,
        preset=wanted.preset,
        parameters=wanted.parameters,
        programme=programme,
        record=wanted.record,
    )
    notes = notes_on(wanted.parameters, run.parameters)
    return filled(StartedRun, run, parameter_notes=notes)


@router.get(
    "",
    summary="The newest runs",
    description=f"Newest first, at most {MOST_RUNS}. `GET /api/history` returns all, in pages.",
    responses=refusals(503),
)
async def list_runs(server: TheServer) -> list[Run]:
    return [filled(Run, run) for run in await server.runs.archive.newest()]


@router.get("/{id}", summary="One run", responses=refusals(404, 503))
async def get_run(id: NameInPath, server: TheServer) -> Run:
    return filled(Run, await server.runs.archive.find(id))


@router.patch(
    "/{id}", summary="Name, tags and notes of a run", responses=refusals(404, 422, 503, 507)
)
async def change_run(id: NameInPath, change: RunChange, server: TheServer) -> Run:
    run = await server.runs.history.annotate(
        id, name=change.name, tags=change.tags, notes=change.notes
    )
    return filled(Run, run)


@router.delete("/{id}", status_code=204, summary="Delete a run", responses=refusals(404, 409, 503))
async def delete_run(id: NameInPath, server: TheServer) -> None:
    """The run is hidden, and permanently deleted some days later; see ``undo_days`` of the history.

    An unfinished re-run is cancelled, and nothing of it is kept.
    """
    await server.runs.delete(id)


@router.post("/{id}/recover", summary="Undo a deletion", responses=refusals(404, 503))
async def recover_run(id: NameInPath, server: TheServer) -> Run:
    return filled(Run, await server.runs.history.recover(id))


@router.post("/{id}/stop", summary="Stop a run", responses=refusals(404, 409, 503))
async def stop_run(id: NameInPath, server: TheServer) -> Run:
    """The source stays open."""
    return filled(Run, await server.runs.stop(id))


@router.head("/{id}/recording", include_in_schema=False)
@router.get(
    "/{id}/recording",
    summary="A run's recording, MCAP",
    response_class=FileResponse,
    responses={
        200: {"content": {"application/octet-stream": {}}},
        206: {"description": "The part requested by the Range header."},
        304: {"description": "The client has it already: If-None-Match names its ETag."},
        416: {"description": "The requested part does not exist."},
        **refusals(404, 409, 503),
    },
)
async def get_recording(id: NameInPath, server: TheServer) -> FileResponse:
    """Everything recorded in a run; opens in Foxglove and Lichtblick, and as a source."""
    run = await server.runs.archive.find(id)
    path = await server.runs.archive.recording(id)
    headers = {"content-disposition": content_disposition(f"{file_stem(run)}.mcap")}
    return StoredFileResponse(path, media_type="application/octet-stream", headers=headers)


@router.get(
    "/{id}/speeds",
    response_model=list[SpeedEntry],
    summary="Speeds over time",
    responses={
        200: {"content": {"text/csv": {"schema": {"type": "string"}}}},
        **refusals(404, 422, 503),
    },
)
async def get_speeds(
    id: NameInPath,
    server: TheServer,
    format: Annotated[
        Literal["json", "csv"], Query(description="csv returns a file for download.")
    ] = "json",
) -> Response:
    """Estimates, ground truth, commands and encoders; unknown is null in JSON, empty in CSV."""
    rows = await server.runs.archive.speeds(id)
    if format == "csv":
        text = await asyncio.to_thread(_csv, rows)
        name = f"{file_stem(await server.runs.archive.find(id))}.csv"
        return attachment(text, name, "text/csv; charset=utf-8")
    return Response(await asyncio.to_thread(_json, rows), media_type="application/json")


@router.get("/{id}/incidents", summary="Robot stops during a run", responses=refusals(404, 503))
async def get_incidents(id: NameInPath, server: TheServer) -> list[RobotIncident]:
    """Oldest first."""
    return [filled(RobotIncident, each) for each in await server.runs.archive.incidents(id)]


def _entries(rows: Sequence[SpeedRow]) -> list[dict[str, Any]]:
    return [{name: getattr(row, name) for name in _COLUMNS} for row in rows]


def _json(rows: Sequence[SpeedRow]) -> str:
    return json.dumps(_entries(rows), allow_nan=False)


def _csv(rows: Sequence[SpeedRow]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, _COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(_entries(rows))
    return text.getvalue()
