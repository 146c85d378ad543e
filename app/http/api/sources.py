"""What frames come from, and how they are played."""

from __future__ import annotations

from collections.abc import Sequence

from fastapi import APIRouter

from app.contract.commands import SetPlayback
from app.contract.status import PlaybackStatus, SourceEntry, Status
from app.http.api.common import TheServer
from app.http.api.models import PlaybackChange, SourceChoice
from app.http.api.refusals import refusals
from app.server.source.hints import source_entries
from app.server.status import status

router = APIRouter(tags=["source"])


@router.get("/sources", response_model=list[SourceEntry], summary="Sources to choose from")
def get_sources() -> Sequence[dict[str, str]]:
    """The built-in scenarios, and the kinds of text that name other sources."""
    return source_entries()


@router.put(
    "/source",
    response_model=Status,
    summary="Open another source",
    responses=refusals(409, 415, 422, 503),
)
async def put_source(choice: SourceChoice, server: TheServer) -> Status:
    """Observe it without keeping anything. What cannot be opened leaves the old one open."""
    await server.source.open(choice.source, choice.calibration)
    return status(server)


@router.post(
    "/playback",
    response_model=PlaybackStatus,
    summary="Pause, step, seek, change the rate, loop, restart",
    responses=refusals(409, 415, 422, 503),
)
async def post_playback(change: PlaybackChange, server: TheServer) -> PlaybackStatus:
    """The playback as it is afterwards. Live sources cannot be paused."""
    return await server.source.play(SetPlayback(**change.model_dump()))
