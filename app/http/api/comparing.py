"""Two methods compared on identical frames."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Response
from pydantic import Field

from app.contract.comparing import ComparisonStatus
from app.http.api.common import TheServer
from app.http.api.refusals import refusals
from app.http.api.values import Finite, In, Name, Spec

router = APIRouter(prefix="/comparison", tags=["runs"])


class ComparisonStart(In):
    source: Spec | None = Field(
        None, description="null: the open source; for live cameras, their last seconds."
    )
    seconds: Annotated[
        Finite, Field(ge=1, le=30, description="Duration on the source's clock.")
    ] = 8.0
    presets: Annotated[list[Name], Field(min_length=2, max_length=2)] = Field(
        ["paper", "default"], description="One run is made with each, from the same frames."
    )


@router.get("", summary="Progress of the comparison of two methods")
async def get_comparison(server: TheServer) -> ComparisonStatus:
    return server.runs.methods.facts()


@router.post(
    "",
    status_code=202,
    summary="Compare two methods on the same frames",
    responses=refusals(409, 422, 503, 507),
)
async def start_comparison(wanted: ComparisonStart, server: TheServer) -> ComparisonStatus:
    """Runs in the background, beside the open source, and produces two runs."""
    return await server.runs.methods.start(wanted.source, wanted.seconds, wanted.presets)


@router.get(
    "/picture.jpg",
    summary="The frame that is being compared, with what each method found in it",
    response_class=Response,
    responses={
        200: {"content": {"image/jpeg": {}}},
        204: {"description": "No frame is being compared at the moment."},
    },
)
async def get_picture(server: TheServer) -> Response:
    """Side by side, in the order of the presets."""
    jpeg = await server.runs.methods.picture()
    if jpeg is None:
        return Response(status_code=204)
    return Response(jpeg, media_type="image/jpeg")


@router.post("/cancel", summary="End the comparison", responses={})
async def cancel_comparison(server: TheServer) -> ComparisonStatus:
    """Discards it; earlier comparisons are kept."""
    await server.runs.methods.cancel()
    return server.runs.methods.facts()
