"""Links to share with others, their QR codes, and the read-only ones, which can be revoked."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated

from fastapi import APIRouter, Depends, HTTPException, Query, Request, Response

from app.contract.sharing import AccessWord, ReadOnlyLinkNow, ShareLinks
from app.http.api.common import NameInPath
from app.http.api.refusals import refusals
from app.http.api.sessions import TheAdmission
from app.http.gate.access import WATCHING_ONLY, Access
from app.http.gate.admission import Admission, access_of, link_of
from app.http.gate.read_only_links import ReadOnlyLink
from app.http.sharing import Sharing, address_used, qr_svg
from app.server import Conflict, NotThere

router = APIRouter(prefix="/links", tags=["sessions"])


def _sharing(request: Request) -> Sharing:
    sharing = request.app.state.sharing
    assert isinstance(sharing, Sharing)
    return sharing


TheSharing = Annotated[Sharing, Depends(_sharing)]
Wanted = Annotated[AccessWord, Query(description="What the link allows.")]


@router.get("", summary="Links to share", responses=refusals(422))
async def get_links(
    request: Request, sharing: TheSharing, admission: TheAdmission, access: Wanted = "read_only"
) -> ShareLinks:
    """With the newest read-only link; a read-only client gets the link that it signed in with."""
    return _links(request, sharing, admission, access)


@router.get(
    "/qr.svg",
    summary="A link as a QR code",
    response_class=Response,
    responses={200: {"content": {"image/svg+xml": {}}}, **refusals(404, 422)},
)
async def get_qr(
    request: Request,
    sharing: TheSharing,
    admission: TheAdmission,
    access: Wanted = "read_only",
    link: Annotated[int, Query(ge=0, le=1000, description="Its index in the list.")] = 0,
) -> Response:
    links = _links(request, sharing, admission, access).links
    if link >= len(links):
        raise NotThere(f"there are {len(links)} links, counted from 0")
    return Response(qr_svg(links[link].link), media_type="image/svg+xml")


@router.get("/read-only", summary="Valid read-only links")
async def get_read_only_links(admission: TheAdmission) -> list[ReadOnlyLinkNow]:
    """The newest first."""
    return [_now(admission, link) for link in reversed(admission.sessions.links.in_force)]


@router.post(
    "/read-only", status_code=201, summary="Make a read-only link", responses=refusals(409)
)
async def make_read_only_link(admission: TheAdmission) -> ReadOnlyLinkNow:
    """It becomes the link to share; the others remain valid."""
    try:
        return _now(admission, await admission.make_link())
    except ValueError as error:
        raise Conflict(str(error)) from None


@router.delete(
    "/read-only/{id}",
    status_code=204,
    summary="Revoke a read-only link",
    responses=refusals(404, 422),
)
async def revoke_read_only_link(id: NameInPath, admission: TheAdmission) -> None:
    """Immediately ends all sessions and WebSockets opened with it.

    If it was the last one, a new link replaces it.
    """
    link = admission.sessions.links.get(id)
    if link is None:
        raise NotThere("this read-only link is not valid")
    await admission.revoke(link)


def _now(admission: Admission, link: ReadOnlyLink) -> ReadOnlyLinkNow:
    sessions = admission.sessions
    made_at = datetime.fromtimestamp(link.made, UTC).isoformat(timespec="seconds")
    return ReadOnlyLinkNow(
        link.id, made_at, sessions.watching(link), shared=link is sessions.links.newest
    )


def _links(
    request: Request, sharing: Sharing, admission: Admission, wanted: AccessWord
) -> ShareLinks:
    scope = request.scope
    if Access(wanted) is Access.OPERATOR and access_of(scope) is not Access.OPERATOR:
        raise HTTPException(403, WATCHING_ONLY)
    asked_at = address_used(request.headers["host"], tls=scope["scheme"] == "https")
    read_only = link_of(scope) or admission.sessions.links.newest
    shared = None if Access(wanted) is Access.OPERATOR else read_only
    return sharing.links(shared, scope["server"][1], asked_at)
