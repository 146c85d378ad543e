"""Mapping of the application's errors to HTTP; the only place that knows both.

Every error reply is JSON that any client can read: ``{"detail": sentence}``, or for invalid values
``{"detail": [{"loc": [...], "msg": sentence, "type": kind}]}``. The input is never echoed: it may
be invalid JSON (NaN, an infinity) or invalid text. A browser that opens an address without a page
gets a page that says so.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from itertools import islice
from typing import Any

import structlog
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.responses import HTMLResponse, Response
from starlette.routing import Match

from app.contract.refusals import Problem, Problems, Refused
from app.contract.values import json_text
from app.http.gate.access import SAFE_METHODS
from app.http.gate.security import wants_page
from app.runtime.errors import ProcessUnavailable
from app.server import Conflict, FieldError, NotAvailable, NotThere
from app.server.journal import Journal
from app.storage import StorageError, StorageExists, StorageFull, StorageMissing
from observer.errors import DynamicObserverError, InputError, ParameterError
from observer.validation import validation_words, with_name

log = structlog.get_logger(__name__)

_METHODS = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE")
_LONGEST_TEXT = 200
# FastAPI's message for a part of a form that has no file name.
_NO_FILE = "Value error, Expected UploadFile"
# nginx's status for a client that left; nobody receives it.
_CLOSED_BY_CLIENT = 499
_MOST_PROBLEMS = 50
_NO_PAGE = """<!doctype html>
<html lang="en">
  <head>
    <meta charset="utf-8">
    <meta name="viewport" content="width=device-width, initial-scale=1">
    <meta name="color-scheme" content="light dark">
    <title>Page not found · Dynamic Observer</title>
    <link rel="icon" href="/static/logo.svg" type="image/svg+xml">
    <script src="/static/app/shell/theme-start.js"></script>
    <link rel="stylesheet" href="/static/style/tokens.css">
    <link rel="stylesheet" href="/static/style/base.css">
    <link rel="stylesheet" href="/static/style/not-found.css">
  </head>
  <body>
    <main>
      <img src="/static/logo.svg" alt="" width="44" height="44">
      <h1>Page not found</h1>
      <p>There is no page at this address.</p>
      <p><a href="/">Back to Dynamic Observer</a> · <a href="/help/">Documentation</a></p>
    </main>
  </body>
</html>
"""
# Several handlers match if one class derives from another, so the narrower ones come first.
_STATUS: tuple[tuple[type[DynamicObserverError], int], ...] = (
    (NotThere, 404),
    (Conflict, 409),
    (NotAvailable, 503),
    (ProcessUnavailable, 503),
    (StorageFull, 507),
    (StorageMissing, 404),
    (StorageExists, 409),
    (StorageError, 503),
)


class SafeJSON(Response):
    """JSON in ASCII, so that no text from a client (half a surrogate pair) can break the reply."""

    media_type = "application/json"

    def render(self, content: Any) -> bytes:
        return json.dumps(content, allow_nan=False, separators=(",", ":")).encode("ascii")


def answer(fact: object, status: int = 200) -> Response:
    """Reply with a dataclass of the contract as it is, without checking it again."""
    return Response(json_text(fact), status, media_type="application/json")


def _refused(problems: Iterable[tuple[Sequence[str | int], str, str]]) -> Response:
    """Reply 422 to invalid values; each problem is (place in the request, sentence, kind)."""
    entries = [
        Problem([part[:_LONGEST_TEXT] if isinstance(part, str) else part for part in loc], *words)
        for loc, *words in islice(problems, _MOST_PROBLEMS)
    ]
    return SafeJSON(asdict(Problems(entries)), 422)


def install_error_handlers(app: FastAPI) -> None:
    """Make the application answer its errors as described above."""
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(HTTPException, _http)
    app.add_exception_handler(DynamicObserverError, _ours)
    app.add_exception_handler(ClientDisconnect, _left)
    app.add_exception_handler(Exception, _unexpected)


def _answer(status: int, detail: str, headers: dict[str, str] | None = None) -> SafeJSON:
    return SafeJSON(asdict(Refused(detail)), status, headers)


async def _left(_: Request, __: Exception) -> Response:
    """Answer nobody: the client closed its connection while its answer was being made."""
    return Response(status_code=_CLOSED_BY_CLIENT)


async def _invalid(_: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    return _refused(
        (each["loc"], with_name(_named(each["loc"]), _words(each)), str(each["type"]))
        for each in error.errors()
    )


def _words(error: Mapping[str, Any]) -> str:
    if str(error["msg"]).startswith(_NO_FILE):
        return 'must be a file: give its part of the form a filename="..."'
    return validation_words(error)


def _named(loc: Sequence[str | int]) -> str:
    """Return what a person calls a place in a request: its field, or the request's body."""
    name = next((part for part in reversed(loc) if isinstance(part, str)), "")
    return "the request body" if name == "body" else name[:_LONGEST_TEXT]


async def _http(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    headers = dict(error.headers or {})
    is_page = wants_page(request.scope) and not request.url.path.startswith("/api/")
    if error.status_code == 404 and is_page:
        return HTMLResponse(_NO_PAGE, 404, headers)
    if "Allow" in headers:
        headers["Allow"] = ", ".join(_methods_at(request))
    return _answer(error.status_code, error.detail, headers)


def _methods_at(request: Request) -> Iterator[str]:
    """Yield all methods of a path; the framework names those of its first route only."""
    for method in _METHODS:
        scope = {**request.scope, "method": method}
        if any(route.matches(scope)[0] is Match.FULL for route in request.app.routes):
            yield method


async def _ours(request: Request, error: Exception) -> Response:
    if request.method not in SAFE_METHODS:
        journal: Journal = request.app.state.journal
        journal.note("warning", f"refused: {error}")
    if isinstance(error, ParameterError):
        return _refused(
            (("body", name), text, "parameter") for name, text in error.problems.items()
        )
    if isinstance(error, InputError):
        field = error.field if isinstance(error, FieldError) else ("body",)
        return _refused([(field, str(error), "value")])
    status = next((status for kind, status in _STATUS if isinstance(error, kind)), 500)
    if status == 500:
        log.error("request_failed", path=request.url.path, reason=str(error))
    return _answer(status, str(error), {"Retry-After": "2"} if status == 503 else None)


async def _unexpected(_: Request, __: Exception) -> Response:
    # The server's log holds the cause; the client learns no internals.
    return _answer(
        500, "the server could not complete this request because of an internal error; see its log"
    )
