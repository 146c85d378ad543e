"""Programmes: timed velocities for robots, built-in ones and the user's own."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import APIRouter
from pydantic import Field, StrictBool, StrictInt

from app.contract.drive import StartProgramme
from app.contract.robots import ProgrammeDetail, ProgrammeEntry
from app.contract.values import filled
from app.http.api.common import NameInPath, TheServer
from app.http.api.refusals import refusals
from app.http.api.values import Identifier, In
from app.server import FieldError, Server
from app.server.robots.profile_library import KeptProfile
from observer.motion_profiles.playing import MAX_REPEAT, duration_s
from observer.motion_profiles.profile_file import MAX_BYTES, profile_text
from observer.rig.rig import Role

router = APIRouter(prefix="/programmes", tags=["programmes"])


class ProgrammeStart(In):
    name: Identifier
    repeat: Annotated[StrictInt, Field(ge=1, le=MAX_REPEAT)] = 1
    reverse: StrictBool = Field(False, description="The same path in reverse.")
    leases: dict[Role, Identifier] = Field(
        description="Leases by role, for every robot that it moves; each robot must be armed."
    )


class ProgrammeText(In):
    text: Annotated[str, Field(strict=True, min_length=1, max_length=MAX_BYTES)]


async def programme_command(server: Server, wanted: ProgrammeStart) -> StartProgramme:
    """Return the command that a request to drive a programme asks for.

    Raises:
        NotThere: there is no such programme. FieldError: a lease is missing.
    """
    kept = await asyncio.to_thread(server.programmes.find, wanted.name)
    for role in kept.profile.roles:
        if role not in wanted.leases:
            raise FieldError(
                ("body", "leases"),
                f"the programme {wanted.name} moves the {role}; take control of it first",
            )
    leases = {str(role): lease for role, lease in wanted.leases.items()}
    return StartProgramme(kept.profile, leases, wanted.repeat, wanted.reverse)


def _entry(kept: KeptProfile) -> ProgrammeEntry:
    profile = kept.profile
    return filled(ProgrammeEntry, profile, duration_s=duration_s(profile), own=kept.own)


def _detail(kept: KeptProfile) -> ProgrammeDetail:
    return ProgrammeDetail(**vars(_entry(kept)), text=profile_text(kept.profile))


@router.get("", summary="All programmes")
async def list_programmes(server: TheServer) -> list[ProgrammeEntry]:
    """Built-in programmes first."""
    return [_entry(each) for each in await asyncio.to_thread(server.programmes.all)]


@router.post("", status_code=201, summary="Save a programme", responses=refusals(409, 422, 507))
async def keep_programme(wanted: ProgrammeText, server: TheServer) -> ProgrammeDetail:
    """Stored under the name in it; your own programme of the same name is replaced."""
    return _detail(await asyncio.to_thread(server.programmes.save, wanted.text))


@router.get("/{name}", summary="One programme", responses=refusals(404))
async def get_programme(name: NameInPath, server: TheServer) -> ProgrammeDetail:
    """Includes its YAML."""
    return _detail(await asyncio.to_thread(server.programmes.find, name))


@router.delete(
    "/{name}",
    status_code=204,
    summary="Delete a programme of your own",
    responses=refusals(404, 409, 503),
)
async def delete_programme(name: NameInPath, server: TheServer) -> None:
    await asyncio.to_thread(server.programmes.delete, name)
