"""Live motion capture: which system to listen to, and how it is aligned with observations."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter
from pydantic import Field

from app.contract.commands import LiveTruthOrder
from app.contract.live_truth import LiveTruthStatus
from app.http.api.common import TheServer
from app.http.api.refusals import refusals
from app.http.api.values import In, Name, Spec
from observer.truth.live.contract import MOST_BODIES

router = APIRouter(prefix="/truth/live", tags=["truth"])


class LiveTruthChoice(In):
    spec: Spec | None = Field(
        description="``vrpn:HOST[:PORT][/NAME,NAME]`` or ``vicon-udp:PORT``; null listens to none."
    )
    observer: Name | None = Field(
        None, description="The body that carries the camera; null: detected automatically."
    )
    ignore: Annotated[list[Name], Field(max_length=MOST_BODIES)] = Field(
        default=[], description="Bodies that are neither observer nor obstacle."
    )


@router.get("", summary="Live motion capture")
async def get_live_truth(server: TheServer) -> LiveTruthStatus | None:
    """Same as in the status; null if no motion capture is connected."""
    return server.source.state.truth


@router.put("", summary="Listen to live motion capture", responses=refusals(422, 503, 507))
async def put_live_truth(choice: LiveTruthChoice, server: TheServer) -> LiveTruthStatus | None:
    """Keeps the source open, also during a run. The setting survives restarts of the server."""
    order = None
    if choice.spec is not None:
        order = LiveTruthOrder(choice.spec, choice.observer, tuple(choice.ignore))
    return await server.live_truth.choose(order)
