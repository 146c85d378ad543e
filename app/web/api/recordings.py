"""The last half minute, kept when something has happened."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter
from pydantic import BaseModel, Field

from app.web.api.common import TheStation, refusals

router = APIRouter(prefix="/recording", tags=["runs"])


class SavedRing(BaseModel):
    file: str = Field(description="Within the data folder; it opens as any recording does.")
    bytes: int
    seconds: float = Field(description="How far back it reaches.")


@router.post(
    "/ring",
    status_code=201,
    response_model=SavedRing,
    summary="Save the last half minute",
    responses=refusals(409, 503, 507),
)
async def save_ring(station: TheStation) -> dict[str, Any]:
    """Of live cameras at any time, and of every run; beside the run, or in the folder rings."""
    return await station.rings.save()
