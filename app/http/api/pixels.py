"""Explanation of why a pixel counts as moving, static or undecided."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query

from app.contract.commands import ExplainPixel
from app.contract.pixel import Pixel
from app.http.api.common import TheServer
from app.http.api.refusals import refusals
from app.server.asking import ask

router = APIRouter(tags=["pixels"])

_MOST_PX = 16384
Coordinate = Annotated[float, Query(ge=-_MOST_PX, le=_MOST_PX, allow_inf_nan=False)]


@router.get(
    "/pixel",
    summary="Why a pixel counts as moving, static or undecided",
    responses=refusals(409, 422, 503),
)
async def get_pixel(u: Coordinate, v: Coordinate, server: TheServer) -> Pixel:
    """Pixel of the newest observed frame: u to the right and v down in the rectified left image."""
    return await ask(server.engine, ExplainPixel(u, v), field=("query",))
