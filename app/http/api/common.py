"""Common parts of the routers: the server, who asks, names in paths."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Path, Request, Response, UploadFile
from fastapi.requests import HTTPConnection

from app.contract.values import LONGEST_NAME
from app.http.file_name import content_disposition, encoded_name
from app.http.gate.admission import session_of
from app.http.sockets.view_feed import ViewFeed
from app.server import Server


def _server(connection: HTTPConnection) -> Server:
    server = connection.app.state.server
    assert isinstance(server, Server)
    return server


TheServer = Annotated[Server, Depends(_server)]


def _feeds(connection: HTTPConnection) -> dict[str, ViewFeed]:
    feeds: dict[str, ViewFeed] = connection.app.state.feeds
    return feeds


Feeds = Annotated[dict[str, ViewFeed], Depends(_feeds)]

# Name or id of a run, a calibration or anything else.
NameInPath = Annotated[str, Path(max_length=LONGEST_NAME)]


def who(request: Request, name: str | None = None) -> str:
    """Say who asks, by the name under which they may drive, or by their address.

    All share one token; a browser with several pages open, or none, has no name of its own.

    Args:
        name: the name they gave.
    """
    where = "this computer" if request.client is None else request.client.host
    if name is not None:
        return f"{name} ({where})"
    session = session_of(request.scope)
    known = None if session is None else _server(request).driving.operators.name_at(session)
    if known is not None:
        return known
    return where if request.client is None else f"an operator at {where}"


def attachment(content: str | bytes, name: str, media_type: str) -> Response:
    """Answer with a file for the client to save."""
    headers = {"Content-Disposition": content_disposition(name)}
    return Response(content, media_type=media_type, headers=headers)


def plain_name(file: UploadFile, otherwise: str) -> str:
    """Return an uploaded file's name without its folders and without unprintable characters.

    Args:
        otherwise: the name if nothing is left.
    """
    # RFC 7578 forbids encoded names, but .NET sends them, with a garbled plain one.
    name = encoded_name(file.headers.get("content-disposition", "")) or file.filename
    last = (name or "").replace("\\", "/").rpartition("/")[2]
    plain = "".join(c for c in last if c.isprintable())[:LONGEST_NAME]
    return plain or otherwise
