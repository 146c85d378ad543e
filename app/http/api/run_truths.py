"""Ground truth added to a run, and re-runs."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Request
from pydantic import Field

from app.contract.runs import AlignChoicesEntry, AlignedRunEntry, CameraOnBodyFacts, StartedRun
from app.contract.values import filled, known
from app.http.api.common import NameInPath, TheServer
from app.http.api.refusals import refusals
from app.http.api.values import FARTHEST_S, ONE_LINE, Changes, Finite, In, Name, notes_on
from app.http.cancel_on_disconnect import while_there
from observer.truth.alignment.camera_on_body import FARTHEST_M, LARGEST_DEG

router = APIRouter(prefix="/runs", tags=["runs"])

Track = Annotated[str, Field(pattern=r"^\d{1,9}[/:]\d{1,9}$")]
Body = Annotated[str, Field(strict=True, min_length=1, max_length=200, pattern=ONE_LINE)]


def _up_to(limit: float) -> Any:
    return Field(ge=-limit, le=limit)


class CameraOnBodyIn(In):
    """Pose with all angles 0: it looks along the body's x axis, with the body's z axis up."""

    x_m: Annotated[Finite, _up_to(FARTHEST_M)]
    y_m: Annotated[Finite, _up_to(FARTHEST_M)]
    z_m: Annotated[Finite, _up_to(FARTHEST_M)]
    pan_deg: Annotated[Finite, _up_to(LARGEST_DEG["pan_deg"])]
    tilt_deg: Annotated[Finite, _up_to(LARGEST_DEG["tilt_deg"])]
    roll_deg: Annotated[Finite, _up_to(LARGEST_DEG["roll_deg"])]


class AlignStart(In):
    truth_id: Name | None = Field(
        None, description="null: the motion capture that was received live with the run."
    )
    observer: Body | None = Field(
        None, description="The body that carries the cameras; null: detected automatically."
    )
    ignore: Annotated[list[Body], Field(max_length=200)] = Field(
        default_factory=list, description="Bodies that are neither observer nor obstacle."
    )
    matches: Annotated[dict[Track, Body | None], Field(max_length=500)] = Field(
        default_factory=dict,
        description="Body of each track (SEGMENT/NUMBER); null: none of them.",
    )
    expected_offset_s: Annotated[Finite, Field(ge=-FARTHEST_S, le=FARTHEST_S)] | None = Field(
        None,
        description="Approximate time offset to add to the times of the ground truth, within 2 s; "
        "for periodic motion. null: it is estimated.",
    )
    camera_on_body: CameraOnBodyIn | None = Field(
        None,
        description="Pose of the left camera on the observer's body. null: estimated, or from the "
        "rig.",
    )


class RerunStart(In):
    name: Name | None = None
    preset: Name | None = None
    parameters: Changes = Field(
        default_factory=dict, description="Changes to the preset, or to the run's own values."
    )


@router.post(
    "/{id}/align",
    summary="Add ground truth to a run",
    responses=refusals(404, 409, 422, 503, 507),
)
async def align_run(
    id: NameInPath, wanted: AlignStart, server: TheServer, request: Request
) -> AlignedRunEntry:
    """Determines time offset, room frame and the body of each track.

    If that is not possible, one sentence says why, and the previous alignment is kept.
    """
    choices = filled(
        AlignChoicesEntry,
        wanted,
        matches={track.replace("/", ":"): body for track, body in wanted.matches.items()},
        camera_on_body=known(CameraOnBodyFacts, wanted.camera_on_body),
    )
    return await while_there(request, server.runs.truths.align(id, wanted.truth_id, choices))


@router.post(
    "/{id}/rerun",
    status_code=201,
    summary="Re-run a recording",
    responses=refusals(404, 409, 422, 503, 507),
)
async def rerun(id: NameInPath, wanted: RerunStart, server: TheServer) -> StartedRun:
    """Processes the recording once, as fast as possible, with the run's own parameters by default.

    Returns the new run, which is ``running``; ``reruns`` of the status reports its progress. The
    open source and the current parameters do not change. It pauses while a robot is armed. Deleting
    it cancels it. If the run has aligned ground truth, it is also aligned with the new run at its
    end.
    """
    run = await server.runs.rerun(
        id, name=wanted.name, preset=wanted.preset, parameters=wanted.parameters
    )
    notes = notes_on(wanted.parameters, run.parameters)
    return filled(StartedRun, run, parameter_notes=notes)
