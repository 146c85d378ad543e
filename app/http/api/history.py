"""The history: searching runs."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query

from app.contract.runs import History
from app.http.api.common import TheServer
from app.http.api.refusals import refusals
from app.http.api.values import NO_NUL, Tag

router = APIRouter(prefix="/history", tags=["runs"])

_MOST_TAGS = 20


@router.get("", summary="Find runs", responses=refusals(422, 503))
async def get_history(
    server: TheServer,
    text: Annotated[
        str,
        Query(
            max_length=200,
            pattern=NO_NUL,
            description="Words that must all occur in name, notes or tags.",
        ),
    ] = "",
    tag: Annotated[
        list[Tag] | None, Query(max_length=_MOST_TAGS, description="Tags that runs must all have.")
    ] = None,
    deleted: Annotated[
        bool,
        Query(description="Only deleted runs that can still be restored, instead of the others."),
    ] = False,
    limit: Annotated[int, Query(ge=1, le=500)] = 50,
    offset: Annotated[int, Query(ge=0, le=1_000_000)] = 0,
) -> History:
    """Newest first, in pages."""
    return await server.runs.history.page(
        text, tag or (), deleted=deleted, limit=limit, offset=offset
    )
