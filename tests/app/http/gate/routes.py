"""All routes of the application."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from fastapi.routing import APIWebSocketRoute, iter_route_contexts
from starlette.routing import Mount


def concrete(path: str) -> str:
    for name, value in (("id", "some-id"), ("name", "left"), ("role", "observer")):
        path = re.sub(rf"\{{{name}(:\w+)?\}}", value, path)
    return path


def http_routes(app: Any) -> Iterator[tuple[str, str]]:
    """Yield method and a concrete path of every HTTP route, files and description included."""
    for context in iter_route_contexts(app.routes):
        path = concrete(str(context.path))
        if isinstance(context.original_route, Mount):
            yield "GET", f"{path}/index.html"
            yield "GET", f"{path}/vendor/uplot/uPlot.esm.js"
        elif not isinstance(context.original_route, APIWebSocketRoute):
            for method in sorted(context.methods or ()):
                yield method, path
    for method in ("GET", "POST", "PUT", "DELETE", "OPTIONS", "TRACE"):
        yield method, "/no/such/route"


def socket_routes(app: Any) -> list[str]:
    paths = [
        str(context.path).replace("{name}", "left")
        for context in iter_route_contexts(app.routes)
        if isinstance(context.original_route, APIWebSocketRoute)
    ]
    return [*paths, "/no/such/socket"]
