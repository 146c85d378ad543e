"""The rig: how the cameras are mounted on their robot, entered by hand or estimated."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import APIRouter, Request, Response
from pydantic import Field, StrictBool

from app.contract.rig import DriveNow, FloorEstimate, RigNow, RigNumber
from app.contract.status import MountStatus
from app.contract.values import filled, known
from app.http.api.common import TheServer, attachment
from app.http.api.refusals import refusals
from app.http.api.values import In
from app.http.gate.access import Access
from app.http.gate.admission import access_of
from app.server import Conflict, Server
from app.server.rig.ground_survey import survey_floor
from observer.rig.rig import Rig, RobotModel, Role

router = APIRouter(prefix="/rig", tags=["rig"])


class RigMount(In):
    """Mount of the left camera; metres and degrees. null: unknown."""

    height_m: RigNumber | None = None
    tilt_deg: RigNumber | None = Field(None, description="Positive: the camera looks down.")
    roll_deg: RigNumber | None = Field(None, description="Positive: the right side is lower.")
    pan_deg: RigNumber | None = Field(
        None, description="Positive: to the left of the driving direction."
    )
    forward_m: RigNumber | None = Field(None, description="From the middle of the axle.")
    left_m: RigNumber | None = None


class RigChange(In):
    mount: RigMount
    models: dict[Role, RobotModel | None] | None = Field(
        None, description="Models of the robots by role; null: unchanged."
    )
    for_simulated: StrictBool = Field(
        False,
        description="Whether simulated sources, which know their mount, use this one instead.",
    )


class RigFile(In):
    text: Annotated[str, Field(strict=True, max_length=100_000)]


def _facts(server: Server) -> RigNow:
    rig, path = server.rig.rig, server.rig.path
    return RigNow(
        mount={key: filled(RigNumber, value) for key, value in rig.mount.values().items()},
        models=dict(rig.models.items()),
        bodies=sorted(rig.T_body_base),
        for_simulated=rig.for_simulated,
        calibration=rig.calibration,
        file=None if path is None else str(path),
        in_use=known(MountStatus, server.source.state.mount),
    )


@router.get("", summary="The current rig")
async def get_rig(server: TheServer) -> RigNow:
    return _facts(server)


@router.put("", summary="Change the rig", responses=refusals(409, 422, 503, 507))
async def put_rig(change: RigChange, server: TheServer) -> RigNow:
    """Restarts the open source with it; motion-capture bodies stay unchanged."""

    def changed() -> Rig:
        calibration = server.source.wanted.calibration
        return server.rig.changed(
            vars(change.mount),
            change.models,
            for_simulated=change.for_simulated,
            calibration=None if calibration is None else calibration.id,
        )

    await server.change_rig(changed)
    return _facts(server)


@router.get(
    "/file",
    summary="The rig as rig.yaml",
    response_class=Response,
    responses={200: {"content": {"application/yaml": {}}}},
)
async def get_file(request: Request, server: TheServer) -> Response:
    """A read-only client gets it without the robots' ports, which may contain keys."""
    operator = access_of(request.scope) is Access.OPERATOR
    text = server.rig.text if operator else server.rig.observed_text
    return attachment(text, "rig.yaml", "application/yaml")


@router.put("/file", summary="Upload a rig.yaml", responses=refusals(409, 422, 503, 507))
async def put_file(file: RigFile, server: TheServer) -> RigNow:
    rig = await asyncio.to_thread(server.rig.parsed, file.text)
    await server.change_rig(lambda: rig)
    return _facts(server)


@router.post(
    "/floor", summary="Estimate height, tilt and roll from the floor", responses=refusals(409, 503)
)
async def post_floor(server: TheServer) -> FloorEstimate:
    """Takes about two seconds; nothing is changed."""
    return await survey_floor(server.engine, server.source.state.camera)


@router.post(
    "/drive",
    status_code=201,
    summary="Start a drive to estimate the offset from the axle",
    responses=refusals(409),
)
async def post_drive(server: TheServer) -> DriveNow:
    """Drive some metres straight and turn on the spot; the frames must have wheel odometry."""
    if server.source.state.camera is None:
        raise Conflict("no source is open to follow a drive with; open one first")
    server.survey.begin()
    return await _drive(server)


@router.get("/drive", summary="Result of the drive so far")
async def get_drive(server: TheServer) -> DriveNow:
    return await _drive(server)


@router.delete("/drive", summary="End the drive")
async def delete_drive(server: TheServer) -> DriveNow:
    """Keeps the result of the drive; the rig stays as it is."""
    server.survey.end()
    return await _drive(server)


async def _drive(server: Server) -> DriveNow:
    return await server.survey.estimate(server.source.state.mount)
