"""Guided checks of what stops a robot, and their records."""

from __future__ import annotations

import asyncio
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Body, Query, Request
from fastapi.responses import Response
from pydantic import Field

from app.contract.robots import CheckEntry, CheckNow, ChecksNow
from app.http.api.common import NameInPath, TheServer, attachment, who
from app.http.api.refusals import refusals
from app.http.api.values import ONE_LINE, In, Name
from app.http.errors import answer
from app.server import Conflict, Server
from observer.rig.rig import Role

router = APIRouter(prefix="/robots", tags=["robots"])

_NOW: dict[int | str, dict[str, Any]] = {200: {"model": CheckNow}}
_FORMATS = {"json": ("json", "application/json"), "markdown": ("md", "text/markdown")}


class By(In):
    """Name of the person who asks, shown to others; the address is added."""

    name: Name | None = None


class CheckStart(By):
    role: Role = "observer"
    note: Annotated[str, Field(strict=True, max_length=500)] | None = None


def _facts(server: Server, status: int = 200) -> Response:
    return answer(server.driving.checks.facts(), status)


@router.get("/check", responses={200: {"model": ChecksNow}})
async def get_check(
    server: TheServer, role: Annotated[Role, Query(description="Role to advise on.")] = "observer"
) -> Response:
    """The guided check in progress or the last one, and whether to check again."""
    return answer(await server.driving.checks.outlook(role))


@router.post(
    "/check",
    status_code=201,
    responses={201: {"model": CheckNow}, **refusals(409, 422)},
    summary="Begin a guided check",
)
async def start_check(
    request: Request, server: TheServer, wanted: Annotated[CheckStart | None, Body()] = None
) -> Response:
    """Moves nothing: somebody drives by hand and follows the steps, and stops are measured."""
    wanted = wanted or CheckStart()
    if server.driving.robot(wanted.role) is None:
        raise Conflict(f"no robot is connected as the {wanted.role}")
    server.driving.checks.start(wanted.role, wanted.note or None, who(request, wanted.name))
    return _facts(server, 201)


@router.post(
    "/check/skip",
    responses={**_NOW, **refusals(409, 422, 507)},
    summary="Skip the current step",
)
async def skip_step(
    request: Request, server: TheServer, by: Annotated[By | None, Body()] = None
) -> Response:
    """The record names who skipped it."""
    await server.driving.checks.skip(who(request, None if by is None else by.name))
    return _facts(server)


@router.delete("/check", responses={**_NOW, **refusals(409, 422, 507)}, summary="Abort the check")
async def give_up_check(
    request: Request,
    server: TheServer,
    name: Annotated[str | None, Query(max_length=100, pattern=ONE_LINE)] = None,
) -> Response:
    """Keeps the record so far, marked as aborted. ``name``: the person who aborts it."""
    await server.driving.checks.give_up(who(request, name or None))
    return _facts(server)


@router.get("/checks", summary="Records of checks")
async def list_checks(server: TheServer) -> list[CheckEntry]:
    """Newest first, a hundred at most."""
    return await asyncio.to_thread(server.driving.checks.records.all)


@router.get(
    "/checks/{name}",
    summary="One record",
    response_class=Response,
    responses={
        200: {"content": {"application/json": {}, "text/markdown": {}}},
        **refusals(404, 422),
    },
)
async def get_check_record(
    name: NameInPath, server: TheServer, format: Literal["json", "markdown"] = "json"
) -> Response:
    """Returns the stored record: JSON for programs, Markdown for people."""
    suffix, media = _FORMATS[format]
    text = await asyncio.to_thread(server.driving.checks.records.text, name, suffix)
    return attachment(text, f"{name}.{suffix}", media)
