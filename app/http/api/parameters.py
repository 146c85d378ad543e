"""Parameters and presets."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Body, Path

from app.http.api.common import TheServer
from app.http.api.models import (
    ParameterEntry,
    ParametersChanged,
    ParametersNow,
    Preset,
    PresetName,
)
from app.http.api.refusals import refusals
from app.http.api.values import Changes, notes_on
from app.server.parameters.in_force import ParametersInForce
from app.server.parameters.manager import PresetEntry
from observer.guard.parameters import AllParameters

router = APIRouter(tags=["parameters"])


def _now(parameters: ParametersInForce) -> ParametersNow:
    return ParametersNow(
        revision=parameters.revision,
        guard_revision=parameters.guard_revision,
        values=dict(parameters.values.flat()),
        preset=parameters.preset,
        frame=parameters.frame,
    )


@router.get("/parameters", response_model=ParametersNow, summary="All parameters in force")
async def get_parameters(server: TheServer) -> ParametersNow:
    return _now(server.parameters.current)


@router.patch(
    "/parameters",
    response_model=ParametersChanged,
    summary="Change parameters",
    responses=refusals(415, 422, 503),
)
async def patch_parameters(
    changes: Annotated[
        Changes, Body(examples=[{"ego_motion.ransac_threshold_px": 2.0, "stereo.matcher": "bm"}])
    ],
    server: TheServer,
) -> ParametersChanged:
    """Dotted names and new values, all or nothing; they act from the next frame on."""
    now = _now(await server.parameters.change(dict(changes)))
    return ParametersChanged(**now.model_dump(), notes=notes_on(changes, now.values))


@router.get(
    "/parameters/schema",
    response_model=list[ParameterEntry],
    response_model_exclude_unset=True,
    summary="What a form needs to know of every parameter",
)
def get_schema() -> list[dict[str, Any]]:
    return AllParameters.declared()


@router.get("/presets", response_model=list[Preset], summary="All presets")
async def get_presets(server: TheServer) -> list[PresetEntry]:
    """To use one, PATCH its values."""
    return server.parameters.presets()


@router.post(
    "/presets",
    status_code=201,
    response_model=Preset,
    summary="Save the values in force as a preset",
    responses=refusals(409, 415, 422, 503, 507),
)
async def post_preset(wanted: PresetName, server: TheServer) -> PresetEntry:
    return await server.parameters.save_preset(wanted.name, wanted.help)


@router.delete(
    "/presets/{name}",
    status_code=204,
    summary="Delete a saved preset",
    responses=refusals(404, 409, 503),
)
async def delete_preset(name: Annotated[str, Path(max_length=100)], server: TheServer) -> None:
    await server.parameters.delete_preset(name)
