"""Pages and files: the panel, sign-in, the documentation, the API description, health."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from urllib.parse import parse_qs

from fastapi import APIRouter, FastAPI, Request
from starlette.datastructures import Headers
from starlette.responses import FileResponse, HTMLResponse, RedirectResponse, Response
from starlette.staticfiles import NotModifiedResponse, StaticFiles
from starlette.types import Receive, Scope, Send

import app as app_package
from app.http.compressed import CompressedFile
from app.http.errors import SafeJSON
from app.http.gate.admission import Refusal
from app.http.gate.headers import DOCS_POLICY, help_policy
from app.http.gate.security import Policy, refused_page, sign_in_headers, wants_page
from app.server import Server

_ASSETS = Path(__file__).parent / "assets"
_REVALIDATED = {"Cache-Control": "no-cache"}
# The sign-in form has one.
_MOST_FIELDS = 10
_PLAIN_SIGN_IN = """<!doctype html>
<html lang="en">
  <head><meta charset="utf-8"><title>Sign in</title></head>
  <body>
    <h1>Dynamic Observer</h1>
    <p>Open the link that the server printed when it started, or enter the token at its end.</p>
    <!-- refusal -->
    <form method="post" action="/sign-in">
      <label>Token <input name="token" type="password" required autofocus></label>
      <button>Sign in</button>
    </form>
  </body>
</html>
"""


def static_folder() -> Path:
    """Return the folder of the panel's files: in the installed package, or beside it in a source
    tree.
    """
    return _installed_or_in_tree("static", "static")


def help_folder() -> Path:
    """Return the folder of the documentation, which need not be built: in the installed package, or
    in a source tree.
    """
    return _installed_or_in_tree("help", "docs/site")


def _installed_or_in_tree(name: str, in_tree: str) -> Path:
    package = Path(app_package.__file__).parent
    inside = package / name
    return inside if (inside / "index.html").is_file() else package.parent / in_tree


def sign_in_page(folder: Path) -> str:
    """Return the sign-in page; it is self-contained."""
    page = folder / "sign-in.html"
    return page.read_text(encoding="utf-8") if page.is_file() else _PLAIN_SIGN_IN


def _tokens(form: bytes) -> list[str]:
    """Return the tokens in a submitted form; a form with too many fields counts as without one."""
    try:
        fields = parse_qs(form.decode("latin-1"), max_num_fields=_MOST_FIELDS)
    except ValueError:
        return []
    return fields.get("token", [])


class PanelFiles(StaticFiles):
    """Files that browsers revalidate each time and rarely have to load again; compressed."""

    sent_with: Mapping[str, str] = _REVALIDATED

    def file_response(
        self,
        full_path: str | os.PathLike[str],
        stat_result: os.stat_result,
        scope: Scope,
        status_code: int = 200,
    ) -> Response:
        file = CompressedFile(full_path, status_code, self.sent_with, stat_result=stat_result)
        if self.is_not_modified(file.headers, Headers(scope=scope)):
            return NotModifiedResponse(file.headers)
        return file


class SceneFiles(PanelFiles):
    """Our scripts for the 3D scene's page, which has no origin; the gate checks its key."""

    sent_with = MappingProxyType({**_REVALIDATED, "Access-Control-Allow-Origin": "null"})


class HelpFiles(PanelFiles):
    """Documentation, each page with the policy that its own inline scripts need.

    It may be built while the server runs.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__(directory=folder, html=True, check_dir=False)
        self._first = folder / "index.html"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if not self._first.is_file():
            missing = HTMLResponse(
                "<p>The documentation is not built; make docs builds it.</p>", 404
            )
            return await missing(scope, receive, send)
        return await super().__call__(scope, receive, send)

    async def get_response(self, path: str, scope: Scope) -> Response:
        response = await super().get_response(path, scope)
        if isinstance(response, FileResponse) and response.media_type == "text/html":
            page = Path(response.path).read_text(encoding="utf-8")
            response.headers["Content-Security-Policy"] = help_policy(page)
        return response


def add_pages(
    app: FastAPI, server: Server, policy: Policy, folder: Path, documentation: Path
) -> None:
    """Add everything that is not part of the REST interface, except the viewer.

    Args:
        folder: the panel's files. documentation: the built documentation, which may be missing.
    """
    router = APIRouter(include_in_schema=False)

    @router.get("/", name="panel")
    async def panel() -> Response:
        page = folder / "index.html"
        if not page.is_file():
            return HTMLResponse("<p>The panel's files are missing; run make setup.</p>", 503)
        return CompressedFile(page, headers=_REVALIDATED)

    @router.get("/sign-in", name="sign-in")
    async def show_sign_in(request: Request) -> Response:
        if policy.admission.is_signed_in(request.scope):
            return RedirectResponse("/", 303)
        page = policy.sign_in_page
        return HTMLResponse(page, headers=sign_in_headers(page))

    @router.post("/sign-in", name="sign in")
    async def sign_in(request: Request) -> Response:
        tokens = _tokens(await request.body())
        cookie = await policy.admission.sign_in(request.scope, tokens)
        if not isinstance(cookie, Refusal):
            return RedirectResponse("/", 303, headers={"Set-Cookie": cookie})
        headers = {k.decode(): v.decode() for k, v in cookie.headers}
        if not wants_page(request.scope):
            return SafeJSON({"detail": cookie.detail}, cookie.status, headers)
        page = policy.sign_in_page
        headers.update(sign_in_headers(page))
        return HTMLResponse(refused_page(page, cookie), cookie.status, headers)

    @router.api_route("/healthz", methods=["GET", "HEAD"], name="alive")
    async def alive() -> Response:
        return SafeJSON({"status": "ok"})

    @router.api_route("/readyz", methods=["GET", "HEAD"], name="ready")
    async def ready() -> Response:
        if server.engine.health.alive:
            return SafeJSON({"status": "ready"})
        return SafeJSON({"status": "the engine is starting"}, 503, {"Retry-After": "1"})

    @router.get("/docs", name="docs")
    async def docs() -> Response:
        if not (folder / "vendor" / "swagger-ui" / "swagger-ui-bundle.js").is_file():
            return HTMLResponse(
                "<p>Swagger UI is not installed; run make setup. The description itself is at "
                '<a href="/openapi.json">/openapi.json</a>.</p>',
                404,
            )
        headers = {"Content-Security-Policy": DOCS_POLICY}
        return FileResponse(_ASSETS / "docs.html", headers=headers)

    @router.get("/docs/start.js", name="docs script")
    async def docs_script() -> Response:
        return FileResponse(_ASSETS / "docs-start.js", media_type="text/javascript")

    @router.get("/help", name="help")
    async def help_() -> Response:
        return RedirectResponse("/help/", 303)

    app.include_router(router)
    app.mount("/help", HelpFiles(documentation), name="documentation")
    if folder.is_dir():
        app.mount("/static", PanelFiles(directory=folder), name="static")
        scripts = SceneFiles(directory=folder / "app" / "scene-frame", check_dir=False)
        app.mount("/viewer/{key}/app", scripts, name="scripts of the 3D scene")
