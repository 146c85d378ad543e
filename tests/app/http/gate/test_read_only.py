"""A read-only link shows everything and changes nothing, on future routes too."""

from __future__ import annotations

import asyncio
import contextlib
import json
from typing import Any

import pytest
from websockets.asyncio.client import ClientConnection
from websockets.exceptions import ConnectionClosed

from app.http.gate.access import FOR_EVERYONE, WATCHING_ONLY, Access
from app.http.gate.admission import COOKIE_NAME
from app.http.gate.read_only_links import MOST_LINKS, ReadOnlyLink, ReadOnlyLinks
from app.http.gate.security import SESSION_OVER

from ..wire import read_on
from .routes import concrete, http_routes, socket_routes

SAFE = ("GET", "HEAD", "OPTIONS")


@pytest.fixture
def links(served: Any) -> ReadOnlyLinks:
    found: ReadOnlyLinks = served.app.state.admission.sessions.links
    return found


@pytest.fixture
def watching(links: ReadOnlyLinks) -> dict[str, str]:
    return bearer(links.newest)


def bearer(link: ReadOnlyLink) -> dict[str, str]:
    return {"Authorization": f"Bearer {link.token}"}


async def heard(socket: ClientConnection, kind: str, **fields: Any) -> dict[str, Any]:
    """The next message of a kind, with these fields."""
    async with asyncio.timeout(10):
        while True:
            message: dict[str, Any] = json.loads(await socket.recv())
            if message["type"] == kind and fields.items() <= message.items():
                return message


async def test_every_change_is_refused_without_effect(
    served: Any, peer: Any, drive: Any, watching: dict[str, str]
) -> None:
    before, asked_before = len(peer.commands), len(drive.commands)
    refused = 0
    async with served.anonymous(**watching) as client:
        for method, path in http_routes(served.app):
            if method in SAFE or path == "/sign-in" or (method, path) in FOR_EVERYONE:
                continue
            answer = await client.request(method, path, json={})
            assert answer.status_code == 403, (method, path)
            assert answer.json() == {"detail": WATCHING_ONLY}
            refused += 1
    described = served.app.openapi()["paths"].values()
    changes = sum(method not in ("get", "head") for each in described for method in each)
    assert refused >= changes - len(FOR_EVERYONE)
    assert (len(peer.commands), len(drive.commands)) == (before, asked_before)


async def test_everything_can_be_read(served: Any, watching: dict[str, str]) -> None:
    async with served.anonymous(**watching) as client:
        for path in ("/", "/api/status", "/api/parameters", "/api/runs", "/api/robots", "/docs"):
            answer = await client.get(path)
            assert answer.status_code not in (401, 403), path
        assert (await client.get("/api/session")).json() == {"access": "read_only"}
    assert (await served.http.get("/api/session")).json() == {"access": "operator"}
    # Review a new socket before adding it here: the gate admits watchers to all of them.
    assert set(socket_routes(served.app)) == {
        "/api/live", "/api/drive", "/api/views/left", "/viewer", "/viewer/{key}",
        "/no/such/socket",
    }  # fmt: skip
    async with served.socket("/api/live", token=None, headers=watching) as socket:
        await heard(socket, "status")


async def test_routes_open_to_everyone_exist(served: Any) -> None:
    described = {
        (method.upper(), concrete(path))
        for path, operations in served.app.openapi()["paths"].items()
        for method in operations
    }
    allowed = {key for key in described if Access.READ_ONLY.allows(*key)} - {
        key for key in described if key[0] in SAFE
    }
    assert len(allowed) == len(FOR_EVERYONE)
    assert ("POST", "/api/robots/stop") in allowed
    assert not Access.READ_ONLY.allows("POST", "/api/robots/stop/")
    assert not Access.READ_ONLY.allows("POST", "/api/robots/stop\n")
    assert not Access.READ_ONLY.allows("post", "/api/robots/reset")


async def test_watchers_can_stop_the_robots(
    served: Any, drive: Any, watching: dict[str, str]
) -> None:
    async with served.anonymous(**watching) as client:
        assert (await client.post("/api/robots/stop")).is_success
    stops = len(drive.commands)
    assert stops > 0
    async with served.socket("/api/drive", token=None, headers=watching) as socket:
        await socket.send(json.dumps({"type": "stop"}))
        async with asyncio.timeout(10):
            while len(drive.commands) == stops:
                await asyncio.sleep(0.01)


async def test_watchers_cannot_drive(served: Any, drive: Any, watching: dict[str, str]) -> None:
    async with served.socket("/api/drive", token=None, headers=watching) as socket:
        before = len(drive.commands)
        await socket.send(json.dumps({"type": "take", "role": "observer"}))
        answer = await heard(socket, "lease")
        assert (answer["state"], answer["sentence"]) == ("refused", WATCHING_ONLY)
        moves = {"type": "drive", "role": "observer", "sequence": 1, "time": 1.0}
        await socket.send(json.dumps({**moves, "speed_mps": 0.5, "turn_rate_radps": 0.0}))
        assert (await heard(socket, "refused"))["sentence"] == WATCHING_ONLY
        await socket.send(json.dumps({**moves, "type": "present", "sequence": 2}))
        assert (await heard(socket, "refused", sequence=2))["sentence"] == WATCHING_ONLY
        await socket.send(json.dumps({"type": "release", "role": "observer"}))
        assert (await heard(socket, "refused", sequence=None))["sentence"] == WATCHING_ONLY
        assert len(drive.commands) == before
    assert served.server.driving.operators.holder("observer") is None


async def test_a_read_only_browser_becomes_operator_with_an_operator_link(
    served: Any, token: str, links: ReadOnlyLinks
) -> None:
    async with served.anonymous() as client:
        assert (await client.get("/", params={"token": links.newest.token})).status_code == 303
        assert (await client.get("/api/session")).json() == {"access": "read_only"}
        answer = await client.patch("/api/parameters", json={})
        assert (answer.status_code, answer.json()["detail"]) == (403, WATCHING_ONLY)
        assert (await client.get("/", params={"token": token})).status_code == 303
        assert (await client.get("/api/session")).json() == {"access": "operator"}
        # An operator who opens a read-only link remains an operator.
        await client.get("/", params={"token": links.newest.token})
        assert (await client.get("/api/session")).json() == {"access": "operator"}
        assert (await client.patch("/api/parameters", json={})).is_success


async def test_a_watcher_signs_out_only_itself(
    served: Any, token: str, links: ReadOnlyLinks
) -> None:
    async with served.anonymous() as client, served.anonymous() as other:
        await client.get("/", params={"token": links.newest.token})
        await other.get("/", params={"token": token})
        assert (await client.delete("/api/sessions")).status_code == 403
        assert (await client.delete("/api/session")).status_code == 204
        assert (await client.get("/api/status")).status_code == 401
        assert (await other.get("/api/status")).is_success


async def test_operators_see_all_links_and_watchers_only_read_only_ones(
    served: Any, token: str, links: ReadOnlyLinks, watching: dict[str, str]
) -> None:
    told = (await served.http.get("/api/links", params={"access": "operator"})).json()
    assert told["access"] == "operator"
    assert [each["here"] for each in told["links"]] == [True]
    assert told["links"][0]["link"] == f"http://127.0.0.1:{served.port}/?token={token}"
    assert "--host 0.0.0.0" in told["note"]
    for query in ({}, {"access": "read_only"}):
        only = (await served.http.get("/api/links", params=query)).json()
        assert only["links"][0]["link"].endswith(f"/?token={links.newest.token}")
    async with served.anonymous(**watching) as client:
        assert (await client.get("/api/links")).json() == only
        for path in ("/api/links", "/api/links/qr.svg"):
            answer = await client.get(path, params={"access": "operator"})
            assert (answer.status_code, answer.json()["detail"]) == (403, WATCHING_ONLY)
            assert token not in answer.text


async def test_links_use_the_host_of_the_request(serve: Any) -> None:
    async with serve(host="0.0.0.0") as served:
        host = f"192.168.7.7:{served.port}"
        told = (await served.http.get("/api/links", headers={"Host": host})).json()
        assert told["links"][0]["address"] == f"http://{host}"
        assert told["links"][-1]["here"]
        assert told["note"] is None


async def test_a_link_is_drawn_as_a_qr_code(served: Any) -> None:
    drawn = await served.http.get("/api/links/qr.svg", params={"access": "read_only", "link": 0})
    assert drawn.headers["content-type"] == "image/svg+xml"
    assert drawn.content.startswith(b"<svg")
    assert b"<script" not in drawn.content
    assert (await served.http.get("/api/links/qr.svg", params={"link": 9})).status_code == 404


async def in_force(served: Any) -> list[tuple[str, int, bool]]:
    told = (await served.http.get("/api/links/read-only")).json()
    return [(each["id"], each["watching"], each["shared"]) for each in told]


async def test_a_revoked_link_ends_only_its_own_sessions_and_sockets(
    served: Any, token: str, links: ReadOnlyLinks
) -> None:
    leaked = links.newest
    made = await served.http.post("/api/links/read-only", json={})
    assert made.status_code == 201
    kept = links.get(made.json()["id"])
    assert kept is not None
    async with contextlib.AsyncExitStack() as stack:
        browsers = {}
        for name, sign_in in (("leaked", leaked.token), ("kept", kept.token), ("operator", token)):
            client = await stack.enter_async_context(served.anonymous())
            await client.get("/", params={"token": sign_in})
            cookie = {"Cookie": f"{COOKIE_NAME}={client.cookies[COOKIE_NAME]}"}
            socket = served.socket("/api/live", token=None, headers=cookie)
            browsers[name] = (client, await stack.enter_async_context(socket))
        script = await stack.enter_async_context(
            served.socket("/api/live", token=None, headers=bearer(leaked))
        )
        for _, socket in browsers.values():
            await heard(socket, "status")
        await heard(script, "status")
        assert await in_force(served) == [(kept.id, 1, True), (leaked.id, 2, False)]
        # A watcher can pass on the link they came by, but cannot revoke any.
        own = (await browsers["leaked"][0].get("/api/links")).json()["links"][0]["link"]
        assert own.endswith(f"?token={leaked.token}")
        refused = await browsers["kept"][0].delete(f"/api/links/read-only/{leaked.id}")
        assert refused.status_code == 403

        path = f"/api/links/read-only/{leaked.id}"
        assert (await served.http.delete(path)).status_code == 204
        for socket in (browsers["leaked"][1], script):
            async with asyncio.timeout(2):
                with pytest.raises(ConnectionClosed) as closed:
                    await read_on(socket)
            assert closed.value.rcvd is not None
            assert closed.value.rcvd.code == SESSION_OVER
        for client in (browsers["leaked"][0], served.http):
            answer = await client.get(
                "/api/status", headers={"Authorization": bearer(leaked)["Authorization"]}
            )
            assert answer.status_code == 401
        assert (
            await browsers["leaked"][0].get("/", params={"token": leaked.token})
        ).status_code == 401
        for name in ("kept", "operator"):
            client, socket = browsers[name]
            assert (await client.get("/api/status")).is_success
            await heard(socket, "heartbeat")
        assert await in_force(served) == [(kept.id, 1, True)]
        assert (await served.http.delete(path)).status_code == 404


async def test_revoking_the_last_link_creates_a_new_one(served: Any, links: ReadOnlyLinks) -> None:
    before = links.newest
    await served.http.delete(f"/api/links/read-only/{before.id}")
    ((now, watching, shared),) = await in_force(served)
    assert (now != before.id, watching, shared) == (True, 0, True)
    told = (await served.http.get("/api/links")).json()["links"][0]["link"]
    assert told.endswith(f"?token={links.newest.token}")
    for _ in range(MOST_LINKS - 1):
        assert (await served.http.post("/api/links/read-only", json={})).status_code == 201
    refused = await served.http.post("/api/links/read-only", json={})
    assert refused.status_code == 409
    assert "revoke one" in refused.json()["detail"]
