"""No access without permission: on every route of the application, new ones included."""

from __future__ import annotations

from typing import Any

from .raw import bearer, raw, raw_request, refusal
from .routes import concrete, http_routes, socket_routes

FORM = "application/x-www-form-urlencoded"
PUBLIC = {
    *((method, path) for method in ("GET", "HEAD") for path in ("/healthz", "/readyz")),
    ("GET", "/sign-in"),
}


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
