"""Clips of the last half minute, saved when something has happened."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.responses import FileResponse

from app.contract.runs import ClipEntry, ClipFile
from app.contract.values import filled
from app.http.api.common import NameInPath, TheServer
from app.http.api.refusals import refusals
from app.http.stored_file import StoredFileResponse

router = APIRouter(prefix="/recording", tags=["runs"])


@router.post(
    "/clips",
    status_code=201,
    summary="Save the last half minute",
    responses=refusals(409, 503, 507),
)
async def save_clip(server: TheServer) -> ClipFile:
    """Works for live cameras at any time, and during every run. Saved with the run, or in the
    folder ``clips``.
    """
    return await server.runs.clips.save()


@router.get("/clips", summary="All saved clips")
async def list_clips(server: TheServer) -> list[ClipEntry]:
    """Newest first."""
    return [
        filled(ClipEntry, clip, source=str(clip.path)) for clip in await server.runs.clips.all()
    ]


@router.head("/clips/{name}", include_in_schema=False)
@router.get(
    "/clips/{name}",
    summary="A saved clip, MCAP",
    response_class=FileResponse,
    responses={200: {"content": {"application/octet-stream": {}}}, **refusals(404)},
)
async def get_clip(name: NameInPath, server: TheServer) -> FileResponse:
    """Opens in Foxglove and Lichtblick, and as a source."""
    clip = await server.runs.clips.find(name)
    return StoredFileResponse(clip.path, filename=clip.path.name)


@router.delete(
    "/clips/{name}",
    status_code=204,
    summary="Permanently delete a saved clip",
    responses=refusals(404, 503),
)
async def delete_clip(name: NameInPath, server: TheServer) -> None:
    """The recording of the run that was in progress is kept."""
    await server.runs.clips.delete(name)
