"""Links to share with others, and their QR codes."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, HTTPException, Query, Request, Response

from app.contract.sharing import AccessWord, ShareLinks
from app.http.api.refusals import refusals
from app.http.gate.access import WATCHING_ONLY, Access
from app.http.gate.admission import access_of
from app.http.sharing import Sharing, address_used, qr_svg
from app.server import NotThere

router = APIRouter(prefix="/links", tags=["sessions"])


def _sharing(request: Request) -> Sharing:
    sharing = request.app.state.sharing
    assert isinstance(sharing, Sharing)
    return sharing


TheSharing = Annotated[Sharing, Depends(_sharing)]
Wanted = Annotated[AccessWord, Query(description="What the link allows.")]


@router.get("", summary="Links to share", responses=refusals(422))
async def get_links(
    request: Request, sharing: TheSharing, access: Wanted = "read_only"
) -> ShareLinks:
    """Whoever only watches gets read-only links only."""
    return _links(request, sharing, access)


@router.get(
    "/qr.svg",
    summary="A link as a QR code",
    response_class=Response,
    responses={200: {"content": {"image/svg+xml": {}}}, **refusals(404, 422)},
)
async def get_qr(
    request: Request,
    sharing: TheSharing,
    access: Wanted = "read_only",
    link: Annotated[int, Query(ge=0, le=1000, description="Its place in the list.")] = 0,
) -> Response:
    links = _links(request, sharing, access).links
    if link >= len(links):
        raise NotThere(f"there are {len(links)} links, counted from 0")
    return Response(qr_svg(links[link].link), media_type="image/svg+xml")


def _links(request: Request, sharing: Sharing, wanted: AccessWord) -> ShareLinks:
    access = Access(wanted)
    if access is Access.OPERATOR and access_of(request.scope) is not Access.OPERATOR:
        raise HTTPException(403, WATCHING_ONLY)
    scope = request.scope
    asked_at = address_used(request.headers["host"], tls=scope["scheme"] == "https")
    return sharing.links(access, scope["server"][1], asked_at)
