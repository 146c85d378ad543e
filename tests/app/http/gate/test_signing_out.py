"""Signing in and out over a real port: what it opens, and what it closes at once."""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.typing import Subprotocol

from app.contract.drive import ReleaseLease
from app.http.server import create_app
from app.settings import Settings
from app.viewer import NullViewer
from observer.robots.contract import RobotPort

from ..scene import PROTOCOL, real_viewer
from ..wire import read_on
from .browsers import COOKIE, browser, cookie

SESSION_OVER = 4401
SOCKETS = ("/api/live", "/api/views/left", "/api/drive", "/viewer")
VIEWER = {"/viewer": {"subprotocols": [Subprotocol(PROTOCOL)]}}


async def status_with(served: Any, headers: dict[str, str]) -> int:
    async with served.anonymous(**headers) as client:
        return int((await client.get("/api/status")).status_code)


async def closed_with(socket: Any) -> int | None:
    """Return the server's close code for a socket, however much it sends before."""
    async with asyncio.timeout(10):
        with pytest.raises(ConnectionClosed) as closed:
            await read_on(socket)
    return closed.value.rcvd.code if closed.value.rcvd else None


async def test_each_browser_gets_its_own_session(served: Any, token: str, tmp_path: Path) -> None:
    async with browser(served, token) as one, browser(served, token) as other:
        assert one.cookies[COOKIE] != other.cookies[COOKIE]
        assert token not in (one.cookies[COOKIE], other.cookies[COOKIE])
        # The link opened again, as in another tab: whoever drives is not cut off.
        before = one.cookies[COOKIE]
        again = await one.get("/", params={"token": token})
        assert again.headers["set-cookie"].startswith(f"{COOKIE}={before};")
        # A wrong link does not sign out.
        assert (await one.get("/", params={"token": "wrong"})).status_code == 401
        assert (await one.get("/api/status")).is_success
        assert (await one.get("/sign-in")).headers["location"] == "/"
    # The token changes with a restart, so no sessions are saved.
    assert not (tmp_path / "sessions.json").exists()


async def test_neither_the_token_nor_the_old_cookie_is_a_session(served: Any, token: str) -> None:
    for name in ("dynamic_observer_token", COOKIE):
        headers = {"Cookie": f"{name}={token}"}
        assert await status_with(served, headers) == 401
        with pytest.raises(InvalidStatus):
            async with served.socket("/api/live", token=None, headers=headers):
                pass
    # Expired session ids are not guesses at the token: an open page retries often.
    statuses = {await status_with(served, {"Cookie": f"{COOKIE}=over"}) for _ in range(8)}
    assert statuses == {401}


async def test_signing_out_closes_only_this_browsers_connections(
    serve: Any, token: str, peer: Any, drive: Any, eventually: Any
) -> None:
    peer.world = "simulated:lab/1"
    peer.robots = (RobotPort("observer", "socket://127.0.0.1:5001", "amigo-sh", "the observer"),)
    async with serve(viewer=real_viewer) as served, contextlib.AsyncExitStack() as stack:
        await eventually(lambda: served.app.state.viewer.viewer.port is not None, 30)
        await eventually(lambda: drive.robots)
        mine = await stack.enter_async_context(browser(served, token))
        theirs = await stack.enter_async_context(browser(served, token))
        sockets = [
            await stack.enter_async_context(
                served.socket(path, token=None, headers=cookie(mine), **VIEWER.get(path, {}))
            )
            for path in SOCKETS
        ]
        script = await stack.enter_async_context(served.socket("/api/live"))
        other = await stack.enter_async_context(
            served.socket("/api/live", token=None, headers=cookie(theirs))
        )
        await sockets[2].send(json.dumps({"type": "take", "role": "observer", "takeover": False}))
        await eventually(lambda: drive.leases)
        headers = cookie(mine)
        began = time.monotonic()
        answer = await mine.delete("/api/session")
        assert answer.status_code == 204
        assert answer.headers["set-cookie"].startswith(f"{COOKIE}=; Path=/; Max-Age=0;")
        assert COOKIE not in mine.cookies
        assert [await closed_with(each) for each in sockets] == len(SOCKETS) * [SESSION_OVER]
        # Like an operator whose connection is lost: the drive process stops the robot.
        await eventually(lambda: drive.of(ReleaseLease) and not drive.leases)
        assert time.monotonic() - began < 5
        # A copy of the cookie is worthless.
        assert await status_with(served, headers) == 401
        with pytest.raises(InvalidStatus):
            async with served.socket("/api/live", token=None, headers=headers):
                pass
        assert (await theirs.get("/api/status")).is_success
        for socket in (script, other):
            async with asyncio.timeout(10):
                assert await socket.recv()


async def test_signing_out_everywhere_does_not_affect_scripts(served: Any, token: str) -> None:
    async with browser(served, token) as one, browser(served, token) as other:
        async with served.socket("/api/live", token=None, headers=cookie(other)) as socket:
            assert (await one.delete("/api/sessions")).status_code == 204
            assert await closed_with(socket) == SESSION_OVER
        assert (await other.get("/api/status")).status_code == 401
        assert (await served.http.get("/api/status")).is_success
        # A script can sign everybody out, but has no session of its own.
        refused = await served.http.delete("/api/session")
        assert refused.status_code == 404
        assert "no session" in refused.json()["detail"]
        assert (await served.http.delete("/api/sessions")).status_code == 204


async def test_another_site_cannot_sign_anyone_out(served: Any, token: str) -> None:
    async with browser(served, token) as client:
        for path in ("/api/session", "/api/sessions"):
            for headers in ({"Origin": "https://evil.example"}, {"Sec-Fetch-Site": "cross-site"}):
                assert (await client.delete(path, headers=headers)).status_code == 403
        assert (await client.get("/api/status")).is_success


async def test_a_refused_token_is_shown_on_the_page(served: Any, token: str) -> None:
    async with served.anonymous(Accept="text/html") as client:
        plain = await client.get("/")
        assert plain.status_code == 401
        assert 'role="alert">' not in plain.text
        wrong = await client.post("/sign-in", data={"token": "<b>wrong"})
        assert wrong.status_code == 401
        assert "Wrong token.</p>" in wrong.text
        assert "<b>wrong" not in wrong.text
        assert COOKIE not in client.cookies
        right = await client.post("/sign-in", data={"token": token})
        assert (right.status_code, right.headers["location"]) == (303, "/")


async def test_sessions_survive_a_restart_only_with_the_same_token(
    tmp_path: Path, peer: Any, drive: Any, storage: Any, serve_app: Any, token: str
) -> None:
    """And another token ends them."""
    chosen = Settings(data=tmp_path, token_file=tmp_path / "token")

    def app(token: str) -> Any:
        viewer = NullViewer("not in this test")
        return create_app(
            chosen, token, engine=peer, drive=drive, storage=storage, viewer=lambda _: viewer
        )

    async with (
        serve_app(app(token), chosen) as served,
        browser(served, token) as client,
        browser(served, token) as other,
    ):
        headers, signed_out = cookie(client), cookie(other)
        assert (await other.delete("/api/session")).is_success
    async with serve_app(app(token), chosen) as served:
        assert await status_with(served, headers) == 200
        assert await status_with(served, signed_out) == 401
    async with serve_app(app("another-" + token), chosen) as served:
        assert await status_with(served, headers) == 401
