"""How everything is."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter

from app.http.api.common import TheServer
from app.http.api.models import Status
from app.server.status import status

router = APIRouter(tags=["status"])


@router.get("/status", response_model=Status, summary="Everything at a glance")
async def get_status(server: TheServer) -> dict[str, Any]:
    """Engine, source, run, rates, latency, timings and losses."""
    return status(server)
