"""Signing in: by link, by form, and what a browser without token is shown."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import httpx

from app.http.server import create_app
from app.settings import Settings


async def test_the_link_token_becomes_a_cookie_and_is_removed_from_the_url(
    served: Any, token: str
) -> None:
    async with served.anonymous() as client:
        answer = await client.get("/", params={"token": token})
        assert answer.status_code == 303
        assert answer.headers["location"] == "/"
        cookie = answer.headers["set-cookie"]
        name, _, session_id = cookie.partition(";")[0].partition("=")
        assert name == "dynamic_observer_session"
        assert len(session_id) * 6 >= 128
        assert token not in cookie
        assert f"Max-Age={30 * 24 * 3600};" in cookie
        assert "HttpOnly" in cookie
        assert "SameSite=Strict" in cookie
        assert "Path=/" in cookie
        assert "Secure" not in cookie
        assert (await client.get("/api/status")).is_success
        jar = {"Cookie": f"other=1; {name}={session_id}"}
        async with served.socket("/api/live", token=None, headers=jar) as socket:
            assert await socket.recv()


async def test_with_tls_the_cookie_is_secure(tmp_path: Path, peer: Any, token: str) -> None:
    pem = tmp_path / "unused.pem"
    settings = Settings(data=tmp_path, tls_cert=pem, tls_key=pem)
    app = create_app(settings, token, engine=peer)

    transport = httpx.ASGITransport(app)
    async with httpx.AsyncClient(transport=transport, base_url="https://localhost") as client:
        answer = await client.get("/", params={"token": token})
        assert answer.status_code == 303
        assert answer.headers["set-cookie"].endswith("; Secure")
        foreign = {"Origin": "http://localhost"}
        assert (await client.get("/sign-in", headers=foreign)).status_code == 403
    await peer.stop()


async def test_a_user_signs_in_by_form(served: Any, token: str) -> None:
    async with served.anonymous() as client:
        page = await client.get("/sign-in")
        assert page.is_success
        assert page.headers["referrer-policy"] == "same-origin"
        assert "'unsafe-inline'" not in page.headers["content-security-policy"]
        assert (await client.post("/sign-in", data={"token": "wrong"})).status_code == 401
        assert (await client.post("/sign-in")).status_code == 401
        many = {"token": token, **{f"field{k}": "" for k in range(20)}}
        assert (await client.post("/sign-in", data=many)).status_code == 401
        answer = await client.post("/sign-in", data={"token": token})
        assert answer.status_code == 303
        assert (await client.get("/api/status")).is_success
        foreign = {"Origin": "https://evil.example"}
        answer = await client.post("/sign-in", data={"token": token}, headers=foreign)
        assert answer.status_code == 403


async def test_a_browser_without_token_is_shown_how_to_sign_in(served: Any) -> None:
    async with served.anonymous(Accept="text/html") as client:
        answer = await client.get("/")
        assert answer.status_code == 401
        assert answer.headers["content-type"].startswith("text/html")
        assert 'name="token"' in answer.text
