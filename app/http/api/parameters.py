"""Parameters and presets."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Body, Path

from app.http.api.common import TheStation
from app.http.api.models import (
    ParameterEntry,
    ParametersChanged,
    ParametersNow,
    Preset,
    PresetName,
)
from app.http.api.refusals import refusals
from app.http.api.values import Changes, notes_on
from app.parameter_store import ParametersInForce
from app.server.parameters.desk import PresetEntry
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
async def get_parameters(station: TheStation) -> ParametersNow:
    return _now(station.parameters.current)


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
    station: TheStation,
) -> ParametersChanged:
    """Dotted names and new values, all or nothing; they act from the next frame on."""
    now = _now(await station.change_parameters(dict(changes)))
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
async def get_presets(station: TheStation) -> list[PresetEntry]:
    """To use one, PATCH its values."""
    return station.parameters.presets()


@router.post(
    "/presets",
    status_code=201,
    response_model=Preset,
    summary="Save the values in force as a preset",
    responses=refusals(409, 415, 422, 503, 507),
)
async def post_preset(wanted: PresetName, station: TheStation) -> PresetEntry:
    return await station.parameters.save_preset(wanted.name, wanted.help)


@router.delete(
    "/presets/{name}",
    status_code=204,
    summary="Delete a saved preset",
    responses=refusals(404, 409, 503),
)
async def delete_preset(name: Annotated[str, Path(max_length=100)], station: TheStation) -> None:
    await station.parameters.delete_preset(name)
