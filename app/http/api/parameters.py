"""Parameters and presets."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Body
from pydantic import Field

from app.contract.parameters import ParameterEntry, ParametersChanged, ParametersNow, Preset
from app.contract.values import filled
from app.http.api.common import NameInPath, TheServer
from app.http.api.refusals import refusals
from app.http.api.values import Changes, In, Name, notes_on
from app.server.parameters.in_force import ParametersInForce
from observer.guard.parameters import AllParameters

router = APIRouter(tags=["parameters"])


class PresetName(In):
    name: Name
    help: Annotated[str, Field(strict=True, max_length=300)] = ""


def _now(parameters: ParametersInForce) -> ParametersNow:
    return filled(ParametersNow, parameters, values=parameters.values.flat())


@router.get("/parameters", summary="All parameters in force")
async def get_parameters(server: TheServer) -> ParametersNow:
    return _now(server.parameters.current)


@router.patch("/parameters", summary="Change parameters", responses=refusals(422, 503))
async def patch_parameters(
    changes: Annotated[
        Changes, Body(examples=[{"ego_motion.ransac_threshold_px": 2.0, "stereo.matcher": "bm"}])
    ],
    server: TheServer,
) -> ParametersChanged:
    """Dotted names and new values, all or nothing; they act from the next frame on."""
    now = _now(await server.parameters.change(changes))
    return ParametersChanged(**vars(now), notes=notes_on(changes, now.values))


@router.get(
    "/parameters/schema",
    response_model=list[ParameterEntry],
    response_model_exclude_defaults=True,
    summary="What a form needs to know of every parameter",
)
def get_schema() -> list[dict[str, Any]]:
    return AllParameters.declared()


@router.get("/presets", summary="All presets")
async def get_presets(server: TheServer) -> list[Preset]:
    """To use one, PATCH its values."""
    return server.parameters.presets()


@router.post(
    "/presets",
    status_code=201,
    summary="Save the values in force as a preset",
    responses=refusals(409, 422, 503, 507),
)
async def post_preset(wanted: PresetName, server: TheServer) -> Preset:
    return await server.parameters.save_preset(wanted.name, wanted.help)


@router.delete(
    "/presets/{name}",
    status_code=204,
    summary="Delete a saved preset",
    responses=refusals(404, 409, 503),
)
async def delete_preset(name: NameInPath, server: TheServer) -> None:
    await server.parameters.delete_preset(name)
