"""Access rights, and signing out.

Signing in is not part of the REST interface: scripts send the token itself.
"""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Request, Response

from app.contract.sharing import SessionNow
from app.http.api.refusals import refusals
from app.http.gate.admission import Admission, access_of, session_of
from app.server import NotThere

router = APIRouter(tags=["sessions"])


def _admission(request: Request) -> Admission:
    admission = request.app.state.admission
    assert isinstance(admission, Admission)
    return admission


TheAdmission = Annotated[Admission, Depends(_admission)]


@router.get("/session", summary="Current access rights")
async def get_session(request: Request) -> SessionNow:
    """Of the session or the token that the request came with."""
    return SessionNow(access_of(request.scope).value)


@router.delete("/session", status_code=204, summary="Sign out", responses=refusals(404))
async def sign_out(request: Request, admission: TheAdmission) -> Response:
    """Ends the browser's session at once, with its WebSockets: a robot that it drives stops."""
    session = session_of(request.scope)
    if session is None:
        raise NotThere(
            "this request used the token directly, so there is no session to sign out of"
        )
    return _signed_out(await admission.sign_out(session))


@router.delete("/sessions", status_code=204, summary="Sign out everywhere")
async def sign_out_everywhere(admission: TheAdmission) -> Response:
    """Ends the sessions of all browsers, with their WebSockets: robots that they drive stop.

    Scripts that send the token stay signed in; a new token keeps them out.
    """
    return _signed_out(await admission.sign_out_everywhere())


def _signed_out(cookie: str) -> Response:
    return Response(status_code=204, headers={"Set-Cookie": cookie})
