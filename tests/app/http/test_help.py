"""The documentation is served like every other page, with a policy of its own for each."""

from __future__ import annotations

import base64
import hashlib
import re
from pathlib import Path
from typing import Any

import pytest

from app.http import server as http_server
from app.http.gate.headers import PANEL_POLICY

INLINE = "document.title = 'read'"
PAGE = f"""<!doctype html><title>Home</title>
<script>{INLINE}</script><script src="later.js"></script><p style="color: red">Read.</p>
"""


@pytest.fixture
def built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a documentation with one page and one script, not built yet."""
    folder = tmp_path / "site"
    monkeypatch.setattr(http_server, "help_folder", lambda: folder)
    return folder


def build(folder: Path) -> None:
    folder.mkdir()
    (folder / "index.html").write_text(PAGE)
    (folder / "later.js").write_text("later()")
    (folder.parent / "secret.txt").write_text("not for readers")


async def test_missing_documentation_is_reported_with_how_to_build_it(
    built: Path, serve: Any
) -> None:
    async with serve() as served:
        for path in ("/help/", "/help/first-day.html"):
            answer = await served.http.get(path)
            assert answer.status_code == 404
            assert answer.text == "<p>The documentation is not built; make docs builds it.</p>"
        # The server need not be restarted.
        build(built)
        assert (await served.http.get("/help/")).text == PAGE


async def test_help_requires_sign_in(built: Path, serve: Any) -> None:
    build(built)
    async with serve() as served:
        answer = await served.http.get("/help")
        assert (answer.status_code, answer.headers["Location"]) == (303, "/help/")
        async with served.anonymous() as client:
            for path in ("/help", "/help/", "/help/index.html", "/help/later.js"):
                assert (await client.get(path)).status_code == 401, path
        for path in ("/help/none.html", "/help/..%2fsecret.txt", "/help/%2e%2e/secret.txt"):
            answer = await served.http.get(path)
            assert answer.status_code == 404, path


async def test_a_page_may_run_only_its_own_inline_scripts(built: Path, serve: Any) -> None:
    build(built)
    digest = base64.b64encode(hashlib.sha256(INLINE.encode()).digest()).decode()
    async with serve() as served:
        policy = (await served.http.get("/help/")).headers["Content-Security-Policy"]
        rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
        assert rules["script-src"] == f"'self' 'sha256-{digest}'"
        assert rules["default-src"] == "'none'"
        assert {*rules["connect-src"].split(), *rules["worker-src"].split()} == {"'self'"}
        # Nothing from other servers, and no evaluated strings.
        assert "://" not in policy
        assert "eval" not in policy
        # Whatever is not a page of the documentation keeps the strict policy.
        for path in ("/help/later.js", "/", "/static/index.html", "/api/status", "/help"):
            answer = await served.http.get(path)
            assert answer.headers["Content-Security-Policy"] == PANEL_POLICY, path
        assert (await served.http.get("/help/")).headers["Cache-Control"] == "no-cache"


async def test_a_browser_is_shown_a_page_where_there_is_none(built: Path, serve: Any) -> None:
    build(built)
    browser = {"Accept": "text/html,application/xhtml+xml,*/*;q=0.8"}
    async with serve() as served:
        for path in ("/help/nonsense", "/nonsense", "/static/nonsense.html"):
            answer = await served.http.get(path, headers=browser)
            assert answer.status_code == 404
            assert answer.headers["Content-Type"] == "text/html; charset=utf-8", path
            assert '<a href="/">' in answer.text
            assert (await served.http.get(path)).json() == {"detail": "Not Found"}
        # What gives the page its look and its theme is there.
        for file in re.findall('(?:src|href)="(/static/[^"]+)"', answer.text):
            assert (await served.http.get(file)).status_code == 200, file
        answer = await served.http.get("/api/nonsense", headers=browser)
        assert answer.json() == {"detail": "Not Found"}
