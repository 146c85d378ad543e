"""Parameters and presets."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Body, Path, Query
from pydantic import Field

from app.contract.parameters import (
    LONGEST_PRESET_HELP,
    PRESET_FORMAT,
    ParameterEntry,
    ParametersChanged,
    ParametersNow,
    Preset,
    PresetFormat,
)
from app.contract.values import filled
from app.http.api.common import NameInPath, TheServer
from app.http.api.refusals import refusals
from app.http.api.values import Changes, In, Name, notes_on
from app.server.parameters.in_force import ParametersInForce
from observer.navigation.parameters import AllParameters

router = APIRouter(tags=["parameters"])


_Values = Annotated[
    Changes | None,
    Field(
        description="Changes to the defaults, former names included; default: the current values."
    ),
]


class ReplacingPreset(In):
    help: Annotated[str | None, Field(strict=True, max_length=LONGEST_PRESET_HELP)] = None
    values: _Values = None


class NewPreset(ReplacingPreset):
    """Contents of a preset file."""

    format: PresetFormat = PRESET_FORMAT
    name: Name


def _now(parameters: ParametersInForce) -> ParametersNow:
    return filled(ParametersNow, parameters, values=parameters.values.flat())


@router.get("/parameters", summary="Current values of all parameters")
async def get_parameters(server: TheServer) -> ParametersNow:
    return _now(server.parameters.current)


@router.patch("/parameters", summary="Change parameters", responses=refusals(422, 503))
async def patch_parameters(
    changes: Annotated[
        Changes, Body(examples=[{"ego_motion.ransac_threshold_px": 2.0, "stereo.matcher": "bm"}])
    ],
    server: TheServer,
    based_on: Annotated[
        Name | None, Query(description="The preset that the values start from, if another.")
    ] = None,
) -> ParametersChanged:
    """Dotted names and new values, all or nothing; they act from the next frame on."""
    now = _now(await server.parameters.change(changes, based_on))
    return ParametersChanged(**vars(now), notes=notes_on(changes, now.values))


@router.get(
    "/parameters/schema",
    response_model=list[ParameterEntry],
    response_model_exclude_defaults=True,
    summary="Declarations of all parameters, for forms",
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
    summary="Save a preset from the current values or from a preset file",
    responses=refusals(409, 422, 503, 507),
)
async def post_preset(wanted: NewPreset, server: TheServer) -> Preset:
    """A preset file saved by the panel is a valid body."""
    return await server.parameters.save_preset(wanted.name, wanted.help, wanted.values)


@router.put(
    "/presets/{name:path}",
    summary="Save a preset in place of one of that name",
    responses=refusals(409, 422, 503, 507),
)
async def put_preset(
    name: Annotated[Name, Path()], wanted: ReplacingPreset, server: TheServer
) -> Preset:
    return await server.parameters.save_preset(name, wanted.help, wanted.values, replace=True)


@router.delete(
    "/presets/{name:path}",
    status_code=204,
    summary="Delete a saved preset",
    responses=refusals(404, 409, 503),
)
async def delete_preset(name: NameInPath, server: TheServer) -> None:
    await server.parameters.delete_preset(name)
