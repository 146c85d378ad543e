"""Programmes: timed velocities for robots, those of the project and a person's own."""

from __future__ import annotations

import asyncio
from typing import Annotated, Any

from fastapi import APIRouter, Path

from app.drive.messages import StartProgramme
from app.http.api.common import TheStation
from app.http.api.refusals import refusals
from app.http.api.robot_models import (
    ProgrammeDetail,
    ProgrammeEntry,
    ProgrammeStart,
    ProgrammeText,
)
from app.server import FieldError, Station
from app.server.robots.profile_library import ShelvedProgramme
from observer.motion_profiles import duration_s, programme_text

router = APIRouter(prefix="/programmes", tags=["programmes"])

ProgrammeName = Annotated[str, Path(max_length=100)]


async def programme_command(station: Station, wanted: ProgrammeStart) -> StartProgramme:
    """What a request to drive a programme asks for.

    Raises:
        NotThere: there is no such programme. FieldError: a lease is missing.
    """
    shelved = await asyncio.to_thread(station.programmes.find, wanted.name)
    for role in shelved.programme.roles:
        if role not in wanted.leases:
            raise FieldError(
                ("body", "leases"), f"the programme {wanted.name} moves the {role}; give its lease"
            )
    leases = {str(role): lease for role, lease in wanted.leases.items()}
    return StartProgramme(shelved.programme, leases, wanted.repeat, wanted.reverse)


def _entry(shelved: ShelvedProgramme) -> dict[str, Any]:
    programme = shelved.programme
    return {
        "name": programme.name,
        "title": programme.title,
        "help": programme.help,
        "roles": list(programme.roles),
        "duration_s": duration_s(programme),
        "own": shelved.own,
    }


@router.get("", response_model=list[ProgrammeEntry], summary="All programmes")
async def list_programmes(station: TheStation) -> list[dict[str, Any]]:
    """Those that come with the project first."""
    return [_entry(each) for each in await asyncio.to_thread(station.programmes.all)]


@router.post(
    "",
    status_code=201,
    response_model=ProgrammeDetail,
    summary="Keep a programme",
    responses=refusals(409, 415, 422, 507),
)
async def keep_programme(wanted: ProgrammeText, station: TheStation) -> dict[str, Any]:
    """Under the name it gives itself; your own of the same name is replaced."""
    shelved = await asyncio.to_thread(station.programmes.save, wanted.text)
    return {**_entry(shelved), "text": programme_text(shelved.programme)}


@router.get(
    "/{name}", response_model=ProgrammeDetail, summary="One programme", responses=refusals(404)
)
async def get_programme(name: ProgrammeName, station: TheStation) -> dict[str, Any]:
    """With its YAML."""
    shelved = await asyncio.to_thread(station.programmes.find, name)
    return {**_entry(shelved), "text": programme_text(shelved.programme)}


@router.delete(
    "/{name}",
    status_code=204,
    summary="Forget a programme of your own",
    responses=refusals(404, 409, 503),
)
async def delete_programme(name: ProgrammeName, station: TheStation) -> None:
    await asyncio.to_thread(station.programmes.delete, name)
