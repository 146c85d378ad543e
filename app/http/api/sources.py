"""Sources of frames, and their playback."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter
from pydantic import Field, StrictBool, StrictInt

from app.contract.commands import SetPlayback
from app.contract.status import PlaybackStatus, SourceEntry, Status
from app.http.api.common import TheServer
from app.http.api.refusals import refusals
from app.http.api.values import Finite, Identifier, In, Spec
from app.server.asking import ask
from app.server.source.hints import source_entries
from app.server.status import status

router = APIRouter(tags=["source"])

# A year at 30 Hz.
_LAST_FRAME = 1_000_000_000


class SourceChoice(In):
    source: Spec
    calibration: Identifier | None = Field(None, description="None: the source's own.")


class PlaybackChange(In):
    """Changes the given settings."""

    paused: StrictBool | None = None
    rate: Annotated[Finite, Field(ge=0.1, le=4.0)] | None = None
    loop: StrictBool | None = None
    step: Annotated[StrictInt, Field(ge=0, le=1000)] = Field(
        0, description="Show so many further frames while paused."
    )
    restart: StrictBool = False
    seek: Annotated[StrictInt, Field(ge=0, le=_LAST_FRAME)] | None = Field(
        None, description="Go on from this frame of a recording, and show it also while paused."
    )


@router.get("/sources", summary="Sources to choose from")
def get_sources() -> list[SourceEntry]:
    """The built-in scenarios, and the kinds of text that name other sources."""
    return list(source_entries())


@router.put("/source", summary="Open another source", responses=refusals(409, 422, 503))
async def put_source(choice: SourceChoice, server: TheServer) -> Status:
    """Observe it without keeping anything. What cannot be opened leaves the old one open."""
    await server.source.open(choice.source, choice.calibration)
    return status(server)


@router.post(
    "/playback",
    summary="Pause, step, seek, change the rate, loop, restart",
    responses=refusals(409, 422, 503),
)
async def post_playback(change: PlaybackChange, server: TheServer) -> PlaybackStatus:
    """The playback as it is afterwards. Live sources cannot be paused."""
    return await ask(server.engine, SetPlayback(**change.model_dump()))
