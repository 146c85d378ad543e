"""State of the server."""

from __future__ import annotations

from fastapi import APIRouter

from app.contract.status import Status
from app.http.api.common import TheServer
from app.server.status import status

router = APIRouter(tags=["status"])


@router.get("/status", summary="Status of everything")
async def get_status(server: TheServer) -> Status:
    """Engine, source, run, rates, latency, timings and losses."""
    return status(server)
