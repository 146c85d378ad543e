"""What the routers share: the station, and the documentation of refusals."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import Depends, Path, Request
from fastapi.requests import HTTPConnection

from app.station import Station
from app.web.api.models import Problems, Refused
from app.web.view_feed import ViewFeed

_LONGEST_NAME = 100
_MEANINGS: dict[int, str] = {
    404: "There is no such thing.",
    409: "Not possible in the present state.",
    413: "The body is too large.",
    415: "The body is of the wrong kind.",
    503: "Not possible for the moment; try again.",
    507: "The disk is full.",
}


def _station(connection: HTTPConnection) -> Station:
    station = connection.app.state.station
    assert isinstance(station, Station)
    return station


TheStation = Annotated[Station, Depends(_station)]


def _feeds(connection: HTTPConnection) -> dict[str, ViewFeed]:
    feeds: dict[str, ViewFeed] = connection.app.state.feeds
    return feeds


Feeds = Annotated[dict[str, ViewFeed], Depends(_feeds)]

# In a path.
RunId = Annotated[str, Path(max_length=100)]

# What the gate in front of every route may answer.
GATE_RESPONSES: dict[int | str, dict[str, Any]] = {
    400: {"model": Refused, "description": "The request is malformed, or for another host."},
    401: {"model": Refused, "description": "No token, or a wrong one."},
    403: {"model": Refused, "description": "Sent by a page of another site."},
    429: {"model": Refused, "description": "Too many wrong tokens from this address."},
}


def who(request: Request, name: str | None = None) -> str:
    """Who asks, in words: there is one token for all, so it is where they are.

    Args:
        name: as they call themselves.
    """
    where = "the host itself" if request.client is None else request.client.host
    if name is not None:
        return f"{name} ({where})"
    return where if request.client is None else f"somebody at {where}"


def plain_name(name: str | None, otherwise: str) -> str:
    """An uploaded file's name without its folders and without what is no text.

    Args:
        otherwise: where nothing of it is left.
    """
    last = (name or "").replace("\\", "/").rpartition("/")[2]
    plain = "".join(c for c in last if c.isprintable())[:_LONGEST_NAME]
    return plain or otherwise


def refusals(*codes: int) -> dict[int | str, dict[str, Any]]:
    """The ``responses`` of a route that may answer with these codes."""
    return {
        code: {"model": Problems, "description": "Values were refused; nothing was changed."}
        if code == 422
        else {"model": Refused, "description": _MEANINGS[code]}
        for code in codes
    }
