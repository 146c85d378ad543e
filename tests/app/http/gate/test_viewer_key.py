"""The key in the address of the 3D scene: what it gives access to, and for how long."""

from __future__ import annotations

import re
from typing import Any

import httpx
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from app.http.gate.sessions import Sessions

from ..scene import PROTOCOL, real_viewer
from ..wire import read_on
from .browsers import browser, cookie

ADDRESS = re.compile(r"/viewer/[A-Za-z0-9_-]{43}/")
_SCRIPTS = ("module-workers", "viewer-link", "frame-pace", "main")
# A sandboxed page has this origin and sends no cookie.
SANDBOXED = {"Origin": "null"}


async def signed_in(served: Any, token: str) -> tuple[str, dict[str, str]]:
    """The address of the scene in a browser that signs in, and the headers of that browser."""
    async with browser(served, token) as client:
        answer = await client.get("/viewer/")
        assert answer.status_code == 307
        address = answer.headers["location"]
        assert ADDRESS.fullmatch(address)
        return address, cookie(client)


async def test_the_key_admits_only_to_the_scene(serve: Any, token: str, eventually: Any) -> None:
    async with serve(viewer=real_viewer) as served:
        await eventually(lambda: served.app.state.viewer.viewer.port is not None, 30)
        address, _ = await signed_in(served, token)
        async with served.anonymous() as client:
            page = await client.get(address)
            assert page.is_success
            assert "sandbox allow-scripts;" in page.headers["content-security-policy"]
            scripts = re.findall(r'src="(app/[\w-]+\.js)"', page.text[:2000])
            assert scripts == [f"app/{name}.js" for name in _SCRIPTS]
            for name in (*scripts, "app/scene-client.js"):
                script = await client.get(address + name, headers=SANDBOXED)
                assert script.is_success, name
                assert script.headers["access-control-allow-origin"] == "null"
            for method in ("POST", "PUT", "DELETE"):
                refused = await client.request(method, address, headers=SANDBOXED, json={})
                assert refused.status_code == 403, method
            # Everything but the scene stays closed, however the address begins.
            for path in ("/api/status", "/", f"{address}../api/status", f"{address}%2e%2e/docs"):
                elsewhere = httpx.URL(f"http://127.0.0.1:{served.port}{path}")
                assert (await client.get(elsewhere)).status_code in (401, 404), path
                null = await client.get(elsewhere, headers=SANDBOXED)
                assert null.status_code in (403, 404), path
        own = {"token": None, "headers": SANDBOXED}
        async with served.socket(address.rstrip("/"), subprotocols=[PROTOCOL], **own) as socket:
            assert await socket.recv()
        for path in ("/viewer", "/api/live", "/api/drive"):
            with pytest.raises(InvalidStatus) as refusal:
                async with served.socket(path, **own):
                    pass
            assert refusal.value.response.status_code == 403, path


async def test_the_key_ends_with_its_session(serve: Any, token: str, eventually: Any) -> None:
    async with serve(viewer=real_viewer) as served:
        await eventually(lambda: served.app.state.viewer.viewer.port is not None, 30)
        mine, cookie = await signed_in(served, token)
        theirs, _ = await signed_in(served, token)
        assert mine != theirs
        async with served.socket(
            mine.rstrip("/"), token=None, headers=SANDBOXED, subprotocols=[PROTOCOL]
        ) as socket:
            async with served.anonymous(**cookie) as client:
                assert (await client.delete("/api/session")).is_success
            with pytest.raises(ConnectionClosed):
                await read_on(socket)
            assert socket.close_code == 4401
        async with served.anonymous() as client:
            assert (await client.get(mine)).status_code == 401
            assert (await client.get(mine, headers=SANDBOXED)).status_code == 403
            assert (await client.get(theirs)).is_success


def test_the_key_survives_a_restart_but_not_a_new_token() -> None:
    def table(token: str) -> Sessions:
        return Sessions(token, lambda: 0.0, unused_s=100.0, lifetime_s=1000.0)

    before, after, other = table("one"), table("one"), table("two")
    session = before.find(before.start())
    assert session is not None
    key = session.viewer_key
    after.restore(before.ages())
    found = after.find_by_viewer_key(key)
    assert found is not None
    assert found.digest == session.digest
    other.restore(before.ages())
    assert other.find_by_viewer_key(key) is None
    for guess in ("", key[:-1], key + "A", "\ud800", session.digest.hex()):
        assert after.find_by_viewer_key(guess) is None
