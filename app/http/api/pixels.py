"""Explanation of why a pixel counts as moving, static or undecided."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query

from app.contract.commands import ExplainPixel
from app.contract.pixel import Pixel
from app.http.api.common import TheServer
from app.http.api.refusals import refusals
from app.server.asking import ask
from observer.camera import MAX_IMAGE_PX

router = APIRouter(tags=["pixels"])

Coordinate = Annotated[float, Query(ge=-MAX_IMAGE_PX, le=MAX_IMAGE_PX, allow_inf_nan=False)]


@router.get(
    "/pixel",
    summary="Why a pixel counts as moving, static or undecided",
    responses=refusals(409, 422, 503),
)
async def get_pixel(u: Coordinate, v: Coordinate, server: TheServer) -> Pixel:
    """Pixel of the newest observed frame: u to the right and v down in the rectified left image."""
    return await ask(server.engine, ExplainPixel(u, v), field=("query",))
