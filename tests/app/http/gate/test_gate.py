"""No access without permission: on every route of the application, new ones included."""

from __future__ import annotations

import asyncio
import contextlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest
from fastapi.routing import APIWebSocketRoute, iter_route_contexts
from starlette.routing import Mount
from websockets.exceptions import InvalidStatus

from app.http.server import create_app
from app.settings import Settings

from ..wire import UPLOAD_HEAD

FORM = "application/x-www-form-urlencoded"
PUBLIC = {
    *((method, path) for method in ("GET", "HEAD") for path in ("/healthz", "/readyz")),
    ("GET", "/sign-in"),
}


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


async def test_the_route_walk_finds_every_kind_of_route(served: Any) -> None:
    paths = {path for _, path in http_routes(served.app)}
    described = {concrete(path) for path in served.app.openapi()["paths"]}
    assert described <= paths
    assert {
        "/",
        "/openapi.json",
        "/docs",
        "/viewer/",
        "/static/index.html",
        "/help",
        "/help/index.html",
    } <= paths
    sockets = {"/api/live", "/api/drive", "/api/views/left", "/viewer"}
    assert sockets <= set(socket_routes(served.app))


async def test_every_route_requires_the_token(served: Any, peer: Any, drive: Any) -> None:
    async with served.anonymous() as client:
        before = len(peer.commands)
        asked_before = len(drive.commands)
        answers = {
            (method, path): (await client.request(method, path)).status_code
            for method, path in http_routes(served.app)
        }
        open_to_all = {key for key, status in answers.items() if status != 401}
        assert open_to_all == PUBLIC
        for path in socket_routes(served.app):
            assert await refusal(served, path, token=None) == 401, path
        assert len(peer.commands) == before
        assert len(drive.commands) == asked_before


async def test_every_route_refuses_foreign_hosts(served: Any) -> None:
    for host in ("evil.example", f"evil.example:{served.port}", "127.0.0.1.evil.example"):
        for method, path in http_routes(served.app):
            answer = await served.http.request(method, path, headers={"Host": host})
            assert answer.status_code == 400, (method, path, host)
            if method != "HEAD":
                assert "--allowed-host" in answer.json()["detail"]
    for path in socket_routes(served.app):
        assert await refusal(served, path, headers={"Host": "evil.example"}) == 400, path


async def test_every_route_refuses_foreign_origins(served: Any, peer: Any) -> None:
    before = len(peer.commands)
    other_port = f"http://127.0.0.1:{served.port + 1}"
    for origin in ("https://evil.example", "null", other_port, "file://"):
        for method, path in http_routes(served.app):
            answer = await served.http.request(method, path, headers={"Origin": origin})
            assert answer.status_code == 403, (method, path, origin)
    for path in socket_routes(served.app):
        for origin in ("https://evil.example", "null", other_port):
            assert await refusal(served, path, origin=origin) == 403, (path, origin)
    assert len(peer.commands) == before


async def test_own_pages_are_accepted(serve: Any) -> None:
    async with serve(allowed_hosts=("lab.example",)) as served:
        own = {"Origin": served.url}
        assert (await served.http.patch("/api/parameters", json={}, headers=own)).is_success
        async with served.socket("/api/live", origin=served.url) as socket:
            assert await socket.recv()
        named = {"Host": "lab.example", "Origin": "https://lab.example"}
        assert (await served.http.get("/api/status", headers=named)).is_success


async def test_cross_site_requests_without_origin_are_refused_by_fetch_metadata(
    served: Any,
) -> None:
    for site in ("cross-site", "same-site"):
        headers = {"Sec-Fetch-Site": site}
        answer = await served.http.post("/api/calibrations/deactivate", headers=headers)
        assert answer.status_code == 403
        assert await refusal(served, "/api/live", headers=headers) == 403
    # A link on another page may lead here.
    answer = await served.http.get("/", headers={"Sec-Fetch-Site": "cross-site"})
    assert answer.is_success


async def test_forms_and_text_change_nothing(served: Any, peer: Any) -> None:
    other_kinds = ("/sign-in", "/api/calibrations", "/api/calibrating/images", "/api/truth")

    before = len(peer.commands)
    for method, path in http_routes(served.app):
        if method in ("GET", "HEAD", "OPTIONS") or path in other_kinds:
            continue
        for kind in ("text/plain", FORM, "multipart/form-data; boundary=x", ""):
            headers = {"Content-Type": kind} if kind else {}
            answer = await served.http.request(
                method, path, content=b'{"paused": true}', headers=headers
            )
            assert answer.status_code == 415, (method, path, kind)
    assert len(peer.commands) == before


async def test_wrong_tokens_are_rate_limited_but_the_right_one_is_not(served: Any) -> None:
    async with served.anonymous(Authorization="Bearer wrong") as client:
        statuses = [(await client.get("/api/status")).status_code for _ in range(7)]
        assert statuses == [401] * 5 + [429] * 2
        assert (await client.get("/api/status")).headers["retry-after"]
    assert await refusal(served, "/api/live", token="wrong-too") == 429
    async with served.anonymous() as client:
        guessed = await client.get("/", params={"token": "wrong"})
        assert guessed.status_code == 429
        form = {"token": "wrong"}
        assert (await client.post("/sign-in", data=form)).status_code == 429
    assert (await served.http.get("/api/status")).is_success
    # A request without a token is not a guess.
    async with served.anonymous() as client:
        assert (await client.get("/api/status")).status_code == 401


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


async def test_every_response_has_security_headers(http: Any) -> None:
    for path in ("/", "/api/status", "/no/such/route", "/healthz", "/docs", "/sign-in"):
        headers = (await http.get(path)).headers
        assert headers["x-content-type-options"] == "nosniff", path
        assert headers["x-frame-options"] == "SAMEORIGIN", path
        assert headers["referrer-policy"] in ("no-referrer", "same-origin"), path
        policy = headers["content-security-policy"]
        assert "frame-ancestors 'self'" in policy, path
        scripts = policy.split("script-src")[1].split(";")[0]
        assert "unsafe-inline" not in scripts, path
        assert "server" not in headers, path


async def test_body_limits_apply_to_the_actual_size(serve: Any, peer: Any) -> None:
    async def many_bytes(count: int) -> Any:
        for _ in range(count):
            yield b" " * 65536

    async with serve(body_max_bytes=200_000, calibration_max_bytes=300_000) as served:
        before = len(peer.commands)
        announced = {"Content-Type": "application/json", "Content-Length": str(2 * 1024**3)}
        answer = await raw_request(served.port, "PATCH", "/api/parameters", announced)
        assert b" 413 " in answer.splitlines()[0]
        for path, method in (
            ("/api/parameters", "PATCH"),
            ("/api/runs", "POST"),
            ("/sign-in", "POST"),
        ):
            kind = "application/x-www-form-urlencoded" if path == "/sign-in" else "application/json"
            status = await stream(served, method, path, kind, many_bytes(10))
            assert status == 413, path
        boundary = "multipart/form-data; boundary=x"

        async def upload() -> Any:
            yield UPLOAD_HEAD
            async for part in many_bytes(10):
                yield part

        assert await stream(served, "POST", "/api/calibrations", boundary, upload()) == 413
        assert len(peer.commands) == before
        assert (await served.http.get("/api/status")).is_success


@pytest.mark.parametrize("announced", [True, False])
async def test_a_huge_upload_uses_little_memory(served: Any, announced: bool) -> None:
    process = psutil.Process()
    before = process.memory_info().rss
    reader, writer = await asyncio.open_connection("127.0.0.1", served.port)
    length = f"Content-Length: {2 * 1024**3}" if announced else "Transfer-Encoding: chunked"
    head = [
        "POST /api/calibrations HTTP/1.1",
        f"Host: 127.0.0.1:{served.port}",
        f"Authorization: {bearer()}",
        "Content-Type: multipart/form-data; boundary=x",
        length,
    ]
    writer.write("\r\n".join([*head, "", ""]).encode())
    first = UPLOAD_HEAD.ljust(65536, b"x")
    parts = [first, *(600 * [b"x" * 65536])]
    # Like all clients, this one listens while it sends.
    answer = asyncio.ensure_future(reader.readline())
    most = 0
    with contextlib.suppress(ConnectionError):
        for part in parts:
            writer.write(part if announced else b"10000\r\n" + part + b"\r\n")
            await writer.drain()
            most = max(most, process.memory_info().rss)
    assert b" 413 " in await answer
    assert most - before < 20 * 1024**2
    writer.close()
    assert (await served.http.get("/api/status")).is_success


OUTSIDE = [
    "/static/../pyproject.toml",
    "/static/..%2fpyproject.toml",
    "/static/%2e%2e/pyproject.toml",
    "/static/%2e%2e%2f%2e%2e%2fetc/passwd",
    "/static//etc/passwd",
    "/static/%00",
    "/static/app%00.js",
    "/static/..\\pyproject.toml",
    "/api/runs/..%2f..%2fetc%2fpasswd",
    "/api/runs/%00",
    "/api/views/..%2fleft.jpg",
    "/api/calibrations/..%2f..%2fcanary/file",
    "/viewer/../pyproject.toml",
    "/viewer/%2e%2e/pyproject.toml",
]


async def test_paths_cannot_escape_their_folder(served: Any) -> None:
    for path in OUTSIDE:
        answer = await raw_request(served.port, "GET", path, {"Authorization": bearer()})
        assert 400 <= int(answer.split()[1]) < 500, (path, answer[:200])
        assert b"[project]" not in answer
        assert b"root:" not in answer


NO_HOSTS = [[], ["127.0.0.1", "evil.example"], ["a b"], ["[::1"], ["127.0.0.1:99999"], ["\u00e9"]]


async def test_a_request_needs_exactly_one_valid_host(served: Any) -> None:
    for hosts in NO_HOSTS:
        lines = ["GET /healthz HTTP/1.0", *(f"Host: {host}" for host in hosts), "", ""]
        answer = await raw(served.port, "\r\n".join(lines).encode("latin-1"))
        assert b" 400 " in answer.splitlines()[0], hosts


# --- how the tests speak -----------------------------------------------------------------


def bearer() -> str:
    return "Bearer a-token-of-the-tests-with-256-bits-more-or-less"


async def refusal(served: Any, path: str, *, headers: Any = (), **more: Any) -> int:
    """Return the status with which a handshake is refused; 101 if it is accepted."""
    host = dict(headers).pop("Host", None)
    kept = {name: value for name, value in dict(headers).items() if name != "Host"}
    if host is not None:
        return await raw_handshake(served.port, path, host)
    try:
        async with served.socket(path, headers=kept, **more):
            return 101
    except InvalidStatus as error:
        return error.response.status_code


async def raw_handshake(port: int, path: str, host: str) -> int:
    lines = [
        f"GET {path} HTTP/1.1",
        f"Host: {host}",
        f"Authorization: {bearer()}",
        "Connection: Upgrade",
        "Upgrade: websocket",
        "Sec-WebSocket-Version: 13",
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
        "",
        "",
    ]
    return int((await raw(port, "\r\n".join(lines).encode())).split()[1])


async def raw_request(port: int, method: str, path: str, headers: dict[str, str]) -> bytes:
    sent = {"Host": f"127.0.0.1:{port}", "Authorization": bearer(), **headers}
    lines = [f"{method} {path} HTTP/1.1", *(f"{k}: {v}" for k, v in sent.items()), "", ""]
    return await raw(port, "\r\n".join(lines).encode())


async def raw(port: int, data: bytes) -> bytes:
    """Send raw bytes and read the head of the answer."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        writer.write(data)
        await writer.drain()
        async with asyncio.timeout(10):
            return await reader.readuntil(b"\r\n\r\n") + await reader.read(2000)
    except asyncio.IncompleteReadError as error:
        return error.partial
    finally:
        writer.close()


async def stream(served: Any, method: str, path: str, kind: str, body: Any) -> int:
    """Return the status that answers a body without a stated length."""
    headers = {"Content-Type": kind}
    answer = await served.http.request(method, path, content=body, headers=headers)
    return int(answer.status_code)
