"""Files made from a run: its chart, its report, and files for other tools."""

from __future__ import annotations

from typing import Annotated, Any, get_args

from fastapi import APIRouter, Query, Request, Response

from app.contract.runs import Run, RunChart
from app.contract.values import filled, json_text
from app.http.api.common import NameInPath, TheServer
from app.http.api.refusals import refusals
from app.http.api.values import FARTHEST_S
from app.http.cancel_on_disconnect import while_there
from app.http.gate.headers import REPORT_POLICY
from app.http.made_file import MadeFileResponse
from app.server.errors import FieldError
from app.server.runs.files import ChartFormat, ExportFormat
from app.server.runs.truths import kept_choices
from observer.exporting.choices import TableFormat, TableName

router = APIRouter(prefix="/runs", tags=["runs"])

Instant = Annotated[
    float | None,
    Query(
        ge=-FARTHEST_S,
        le=FARTHEST_S,
        allow_inf_nan=False,
        description="Source time, s; none: its end.",
    ),
]
_CHART_KINDS: dict[ChartFormat, str] = {
    "csv": "text/csv; charset=utf-8",
    "png": "image/png",
    "svg": "image/svg+xml",
    "pdf": "application/pdf",
}
_EXPORT_KINDS: dict[ExportFormat, str] = {
    "zip": "application/zip",
    "csv": "text/csv; charset=utf-8",
    "parquet": "application/vnd.apache.parquet",
    "mp4": "video/mp4",
    "ply": "application/octet-stream",
    "ros2": "application/zip",
}
_TABLES = get_args(TableFormat)


def _file(*kinds: str) -> dict[int | str, dict[str, Any]]:
    """Return the ``responses`` of a route that makes a file."""
    return {
        200: {"content": {kind.partition(";")[0]: {} for kind in kinds}},
        **refusals(404, 409, 422, 503, 507),
    }


@router.get(
    "/{id}/chart",
    response_model=RunChart,
    summary="Estimated, true, commanded and encoder speeds, and their errors",
    responses=refusals(404, 409, 503),
)
async def get_chart(id: NameInPath, server: TheServer, request: Request) -> Response:
    """Gaps are null. There are no errors during the run, or without a recording."""
    run = await server.runs.archive.find(id)
    values = await while_there(request, server.runs.files.chart(run))
    about = json_text(filled(Run, run)).encode()
    choices = kept_choices(run)
    choices_json = b"null" if choices is None else json_text(choices).encode()
    # The values are JSON already and may be long.
    begin = b'{"run":' + about + b',"choices":' + choices_json + b","
    return Response(begin + values[1:], media_type="application/json")


@router.head("/{id}/chart.{format}", include_in_schema=False)
@router.get(
    "/{id}/chart.{format}",
    summary="The chart, or its values, for the visible range",
    response_class=Response,
    responses=_file(*_CHART_KINDS.values()),
)
async def get_chart_file(
    id: NameInPath,
    format: ChartFormat,
    server: TheServer,
    request: Request,
    begin: Instant = None,
    end: Instant = None,
) -> Response:
    if begin is not None and end is not None and begin >= end:
        raise FieldError(("query", "end"), "the end must be after the start")
    run = await server.runs.archive.find(id)
    made = await while_there(request, server.runs.files.chart_file(run, format, begin, end))
    return MadeFileResponse(made, _CHART_KINDS[format])


@router.head("/{id}/report", include_in_schema=False)
@router.get(
    "/{id}/report",
    summary="Report of the run with the paper's figures",
    response_class=Response,
    responses=_file("text/html"),
)
async def get_report(id: NameInPath, server: TheServer, request: Request) -> Response:
    """Takes up to a minute. The page is self-contained: images, data and style are in it."""
    run = await server.runs.archive.find(id)
    made = await while_there(request, server.runs.files.report(run))
    headers = {"content-security-policy": REPORT_POLICY}
    return MadeFileResponse(made, "text/html; charset=utf-8", inline=True, headers=headers)


@router.head("/{id}/export", include_in_schema=False)
@router.get(
    "/{id}/export",
    summary="Export of the run for other tools",
    response_class=Response,
    responses=_file(*_EXPORT_KINDS.values()),
)
async def get_export(
    id: NameInPath,
    server: TheServer,
    request: Request,
    format: Annotated[
        ExportFormat,
        Query(description="zip: everything; ros2: a zip of a bag for ros2 bag play."),
    ] = "zip",
    table: Annotated[
        TableName | None,
        Query(description="For csv and parquet; default: obstacles."),
    ] = None,
) -> Response:
    if table is not None and format not in _TABLES:
        raise FieldError(("query", "table"), "a single table is available only as csv or parquet")
    run = await server.runs.archive.find(id)
    if table is None and format in _TABLES:
        table = "obstacles"
    made = await while_there(request, server.runs.files.export(run, format, table))
    return MadeFileResponse(made, _EXPORT_KINDS[format])
