"""How everything is."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter

from app.station.status import status
from app.web.api.common import TheStation
from app.web.api.models import Status

router = APIRouter(tags=["status"])


@router.get("/status", response_model=Status, summary="Everything at a glance")
async def get_status(station: TheStation) -> dict[str, Any]:
    """Engine, source, run, rates, latency, timings and losses."""
    return status(station)
