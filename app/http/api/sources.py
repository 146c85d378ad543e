"""Sources of frames, and their playback."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from pydantic import Field, StrictBool, StrictInt

from app.contract.commands import SetPlayback
from app.contract.sources import SourceEntry
from app.contract.status import FASTEST_RATE, SLOWEST_RATE, PlaybackStatus, Status
from app.contract.values import LONGEST_SPEC
from app.http.api.common import TheServer
from app.http.api.refusals import refusals
from app.http.api.values import LAST_FRAME, Finite, Identifier, In, Spec
from app.http.cancel_on_disconnect import while_there
from app.server import NotThere
from app.server.asking import ask
from app.server.status import status

router = APIRouter(tags=["source"])


class SourceChoice(In):
    source: Spec
    calibration: Identifier | None = Field(None, description="null: the source's own.")


class PlaybackChange(In):
    """Changes the given settings."""

    paused: StrictBool | None = None
    rate: Annotated[Finite, Field(ge=SLOWEST_RATE, le=FASTEST_RATE)] | None = None
    loop: StrictBool | None = None
    step: Annotated[StrictInt, Field(ge=0, le=1000)] = Field(
        0, description="Number of further frames to show while paused."
    )
    restart: StrictBool = False
    seek: Annotated[StrictInt, Field(ge=0, le=LAST_FRAME)] | None = Field(
        None, description="Frame of a recording to continue from; it is shown even while paused."
    )


@router.get("/sources", summary="Sources to choose from")
async def get_sources(server: TheServer) -> list[SourceEntry]:
    """Recently opened sources, the built-in scenarios, and templates for the others."""
    return await server.source.recent.entries()


@router.get(
    "/sources/picture.jpg",
    summary="A small picture of a listed source",
    response_class=Response,
    responses={200: {"content": {"image/jpeg": {}}}, **refusals(404, 422, 503)},
)
async def get_picture(
    spec: Annotated[str, Query(min_length=1, max_length=LONGEST_SPEC)],
    server: TheServer,
    request: Request,
) -> Response:
    """256 x 128 pixels. Made at the first request, which may take seconds, and kept."""
    entries = await server.source.recent.entries()
    entry = next((each for each in entries if each.spec == spec), None)
    if entry is None:
        raise NotThere(f"there is no such source in the list: {spec[:80]!r}")
    jpeg = await while_there(request, server.source.thumbnails.find(entry))
    # A scenario always looks the same; pictures of private data must not stay in a cache.
    kept = {"cache-control": "private, max-age=86400"} if entry.group == "simulated" else {}
    return Response(jpeg, media_type="image/jpeg", headers=kept)


@router.put("/source", summary="Open another source", responses=refusals(409, 422, 503))
async def put_source(choice: SourceChoice, server: TheServer) -> Status:
    """Observes it without recording. If it cannot be opened, the old one stays open."""
    await server.source.open(choice.source, choice.calibration)
    return status(server)


@router.post(
    "/source/back",
    summary="Return to the source that was open before the recording of a run",
    responses=refusals(409, 422, 503),
)
async def go_back(server: TheServer) -> Status:
    """``before`` of the source in the status says which one it is."""
    await server.source.go_back()
    return status(server)


@router.post(
    "/playback",
    summary="Pause, step, seek, change the rate, loop, restart",
    responses=refusals(409, 422, 503),
)
async def post_playback(change: PlaybackChange, server: TheServer) -> PlaybackStatus:
    """Returns the resulting playback. Live sources cannot be paused."""
    return await ask(server.engine, SetPlayback(**change.model_dump()))
