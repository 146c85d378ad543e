"""Truth laid over a run, and a run observed again."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request

from app.contract.runs import AlignedRunEntry, Run, StartedRun
from app.contract.values import filled
from app.http.api.common import RunId, TheServer
from app.http.api.refusals import refusals
from app.http.api.run_models import AlignStart, RerunStart
from app.http.api.values import notes_on
from app.http.cancel_on_disconnect import while_there
from app.server.runs.truths import AlignChoices
from observer.truth.alignment.camera_on_body import CameraOnBody

router = APIRouter(prefix="/runs", tags=["runs"])


@router.post(
    "/{id}/align",
    response_model=AlignedRunEntry,
    summary="Lay truth over a run",
    responses=refusals(404, 409, 415, 422, 503, 507),
)
async def align_run(
    id: RunId, wanted: AlignStart, server: TheServer, request: Request
) -> dict[str, Any]:
    """Clocks, room and which track is which body are found. Where that is not possible one
    sentence says why, and what was laid over the run before stays.
    """
    camera = wanted.camera_on_body
    choices = AlignChoices(
        wanted.observer,
        wanted.ignore,
        {track.replace("/", ":"): body for track, body in wanted.matches.items()},
        wanted.expected_offset_s,
        None if camera is None else CameraOnBody(**camera.model_dump()),
    )
    work = server.runs.truths.align(id, wanted.truth_id, choices)
    found = await while_there(request, work)
    return {
        **vars(filled(Run, found.run)),
        "alignment": found.alignment,
        "sentence": found.sentence,
    }


@router.post(
    "/{id}/rerun",
    status_code=201,
    response_model=StartedRun,
    summary="Observe a run's recording again",
    responses=refusals(404, 409, 415, 422, 503, 507),
)
async def rerun(id: RunId, wanted: RerunStart, server: TheServer) -> StartedRun:
    """Once through, as fast as it goes, with the run's own parameters where none are given.

    Where truth was laid over the run, it is laid over the new one when it has ended.
    """
    run = await server.runs.rerun(
        id, name=wanted.name, preset=wanted.preset, parameters=wanted.parameters
    )
    notes = notes_on(wanted.parameters, run.parameters)
    return filled(StartedRun, run, parameter_notes=notes)
