"""Ground-truth files: upload, list, delete."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, File, Form, UploadFile

from app.contract.truths import TruthEntry
from app.http.api.common import NameInPath, TheServer, plain_name
from app.http.api.refusals import refusals
from observer.truth.files.known import AngleReading, formats_in_words
from observer.truth.files.units import FASTEST_HZ

router = APIRouter(prefix="/truth", tags=["truth"])


@router.get("", summary="All ground-truth files", responses=refusals(503))
async def list_truths(server: TheServer) -> list[TruthEntry]:
    """Newest first."""
    return await server.runs.truths.all()


@router.post(
    "",
    status_code=201,
    summary="Upload a ground-truth file",
    description=(
        f"Recognised by content: {formats_in_words()}, and truth.csv. If angles can be read in two "
        "ways, the error for the field `angles` gives figures for both; send the file again with "
        "one of them."
    ),
    responses=refusals(422, 503, 507),
)
async def post_truth(
    file: Annotated[UploadFile, File(description="Motion capture, or a truth.csv.")],
    server: TheServer,
    rate_hz: Annotated[
        float | None,
        Form(
            gt=0, le=FASTEST_HZ, allow_inf_nan=False, description="If the file does not state it."
        ),
    ] = None,
    angles: Annotated[
        AngleReading | None,
        Form(description="Meaning of Vicon's three angles, if it cannot be detected."),
    ] = None,
) -> TruthEntry:
    name = plain_name(file, "truth.csv")
    return await server.runs.truths.upload(file.file, name, rate_hz, angles)


@router.delete(
    "/{id}", status_code=204, summary="Delete a ground-truth file", responses=refusals(404, 503)
)
async def delete_truth(id: NameInPath, server: TheServer) -> None:
    """Runs that were compared with it keep their results."""
    await server.runs.truths.delete(id)
