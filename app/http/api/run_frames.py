"""Frames of a run: the image of each, and what was found in it."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query, Request, Response

from app.contract.run_frames import RunFrames
from app.http.api.common import NameInPath, TheServer
from app.http.api.refusals import refusals
from app.http.api.values import LAST_FRAME
from app.http.cancel_on_disconnect import while_there

router = APIRouter(prefix="/runs", tags=["runs"])


@router.get(
    "/{id}/frames/{position}.jpg",
    summary="The left image of a recorded frame",
    response_class=Response,
    responses={200: {"content": {"image/jpeg": {}}}, **refusals(404, 409, 422, 503)},
)
async def get_frame_image(
    id: NameInPath,
    position: Annotated[
        int, Path(ge=0, le=LAST_FRAME, description="Position of the frame in the run, from 0.")
    ],
    server: TheServer,
) -> Response:
    """Rectified, like the boxes of its obstacles; at most 1280 pixels wide.

    A re-run returns the images of the original run.
    """
    jpeg = await server.runs.images.jpeg(id, position)
    return Response(jpeg, media_type="image/jpeg")


@router.get(
    "/{id}/frames",
    response_model=RunFrames,
    summary="What was found in each frame of a run",
    responses=refusals(404, 409, 422, 503, 507),
)
async def get_frames(
    id: NameInPath,
    server: TheServer,
    request: Request,
    first: Annotated[
        int, Query(ge=0, le=LAST_FRAME, description="Position of the first frame.")
    ] = 0,
    count: Annotated[
        int | None,
        Query(ge=1, le=LAST_FRAME, description="Number of frames from there on; default: all."),
    ] = None,
    most: Annotated[
        int | None,
        Query(
            ge=1,
            le=LAST_FRAME,
            description="Maximum number of frames returned, evenly spread over those requested.",
        ),
    ] = None,
) -> Response:
    """Boxes, speeds and, with ground truth, the number of false obstacles so far."""
    run = await server.runs.archive.find(id)
    content = await while_there(request, server.runs.files.frames(run, first, count, most))
    return Response(content, media_type="application/json")
