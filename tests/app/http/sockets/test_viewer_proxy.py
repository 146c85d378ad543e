"""The 3D viewer behind our gate: the real viser, a real client of its protocol."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import AsyncIterator
from typing import Any

import httpx
import msgspec
import pytest
import viser
import zstandard
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.typing import Subprotocol

from app.http.sockets.connections import BadMessage
from app.http.sockets.viewer_proxy import passes
from app.viewer import NullViewer, start_viewer

from ..scene import PROTOCOL, real_viewer
from ..wire import read_on

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1, 0, 0, 0],
    "position": [0.5, 1, 2],
    "fov": 1.2,
    "near": 0.1,
    "far": 1000,
    "image_height": 480,
    "image_width": 640,
    "look_at": [0, 0, 0],
    "up_direction": [0, 0, 1],
}


@pytest.fixture
async def served(serve: Any) -> AsyncIterator[Any]:
    """The application with viser."""
    async with serve(viewer=real_viewer) as served:
        yield served


async def started(served: Any) -> Any:
    """The viewer, once it is up."""
    door = served.app.state.viewer
    while door.viewer.port is None:
        await asyncio.sleep(0.02)
    return door.viewer


async def test_the_scene_is_proxied_and_updated(
    serve: Any, peer: Any, eventually: Any, capsys: Any
) -> None:
    async with serve(viewer=real_viewer) as served:
        viewer = await started(served)
        page = await served.http.get("/viewer/")
        assert page.is_success
        assert len(page.content) > 100_000
        assert "connect-src 'self' data: blob:" in page.headers["content-security-policy"]
        for known in ("{}", "W/{}", '"another", {}', "*"):
            tag = {"If-None-Match": known.format(page.headers["etag"])}
            assert (await served.http.get("/viewer/", headers=tag)).status_code == 304
        away = await served.http.get("/viewer")
        assert (away.status_code, away.headers["location"]) == (307, "/viewer/")

        async with served.socket("/viewer", subprotocols=[PROTOCOL]) as socket:
            assert socket.subprotocol == PROTOCOL
            first = await socket.recv()
            assert isinstance(first, bytes)
            await eventually(lambda: set(peer.watched) == {"cloud", "plain"})
            await socket.send(msgspec.msgpack.encode(CAMERA))
            await eventually(lambda: len(viewer._viser.server.get_clients()) == 1)
            received = 0
            for _ in range(10):
                peer.observe()
                async with asyncio.timeout(5):
                    received += len(await socket.recv())
            # The cloud of 500 points alone takes 4.5 KB.
            assert received > 4500
        await eventually(lambda: peer.watched == ())
        await eventually(lambda: not viewer._viser.server.get_clients())
    assert "viser" not in capsys.readouterr().out


def messages_of(data: bytes) -> list[dict[str, Any]]:
    """Return the messages in one socket message as viser's client reads them, without arrays."""
    end = 16 + int.from_bytes(data[8:16], "little")
    text = zstandard.ZstdDecompressor().decompress(data[16:end])
    messages: list[dict[str, Any]] = msgspec.msgpack.decode(text)["messages"]
    return messages


async def test_layers_are_children_of_nodes_left_to_the_page(served: Any, peer: Any) -> None:
    await started(served)
    facts = (await served.http.get("/api/scene")).json()
    sent: list[dict[str, Any]] = []
    async with served.socket("/viewer", subprotocols=[PROTOCOL]) as socket:
        for _ in range(12):
            async with asyncio.timeout(5):
                sent += messages_of(await socket.recv())
            peer.observe()
    made = {m["name"]: m for m in sent if "props" in m}
    shown = [m for m in sent if m["type"] == "SetSceneNodeVisibilityMessage"]
    for layer in facts["layers"]:
        node = layer["node"]
        assert made[node]["type"] == "FrameMessage"
        below = [name for name in made if name.startswith(f"{node}/")]
        assert below, node
        assert all(m["visible"] for m in shown if m["name"] == node), node
    assert made[facts["display_node"]]["type"] == "FrameMessage"
    assert made[facts["camera_node"]]["type"] == "CameraFrustumMessage"
    # The page hides a layer with a message like these, sent only to its own viewer.
    for message in shown:
        assert set(message) == {"type", "name", "owner", "visible"}
        assert message["owner"] == ""
    assert any(m["name"].endswith("/cloud/points") and m["visible"] for m in shown)


async def test_a_page_opened_before_the_viewer_reloads(serve: Any, eventually: Any) -> None:
    ready = threading.Event()

    def late(_: Any) -> NullViewer:
        ready.wait(10)
        return NullViewer("it is not in this test")

    async with serve(viewer=late) as served:
        page = await served.http.get("/viewer/")
        assert page.status_code == 503
        assert 'http-equiv="refresh"' in page.text
        ready.set()
        await eventually(lambda: served.app.state.viewer.opened)
        page = await served.http.get("/viewer/")
        assert "it is not in this test" in page.text
        assert "refresh" not in page.text


async def test_the_proxy_gives_no_access_to_viser_controls_or_tunnels(
    serve: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    tunnels = []
    monkeypatch.setattr("viser._viser.ViserTunnel", lambda *a: tunnels.append(a))

    async with serve(viewer=real_viewer) as served:
        viewer = await started(served)
        assert viewer._viser.server.get_host() == "127.0.0.1"
        async with served.socket("/viewer", subprotocols=[PROTOCOL]) as socket:
            await socket.recv()
            await socket.send(msgspec.msgpack.encode({"type": "ShareUrlRequest"}))
            await socket.send(msgspec.msgpack.encode(CAMERA))
            async with asyncio.timeout(5):
                assert await socket.recv()
        # Also without the proxy, should a message ever get there.
        assert await asyncio.to_thread(viewer._viser.server.request_share_url) is None
        assert tunnels == []


@pytest.mark.parametrize("shown", [{}, {"X-Dynamic-Observer-Viewer": "guessed"}])
async def test_visers_own_port_admits_only_the_proxy(serve: Any, shown: dict[str, str]) -> None:
    async with serve(viewer=real_viewer) as served:
        viewer = await started(served)
        own = f"127.0.0.1:{viewer.port}"
        with pytest.raises(InvalidStatus) as refused:
            await connect(
                f"ws://{own}/",
                subprotocols=[Subprotocol(PROTOCOL)],
                additional_headers=shown,
                proxy=None,
            )
        assert refused.value.response.status_code == 403
        async with httpx.AsyncClient(headers=shown, trust_env=False) as http:
            assert (await http.get(f"http://{own}/")).status_code == 403


async def test_a_flood_of_camera_poses_does_not_delay_others(serve: Any) -> None:
    async with serve(viewer=real_viewer) as served:
        await started(served)
        async with served.socket("/viewer", subprotocols=[PROTOCOL]) as socket:
            pose = msgspec.msgpack.encode(CAMERA)

            async def flood() -> None:
                while True:
                    await socket.send(pose)

            flooding = asyncio.create_task(flood())
            try:
                for _ in range(5):
                    since = time.monotonic()
                    assert (await served.http.post("/api/robots/stop")).status_code == 200
                    assert time.monotonic() - since < 1.5
            finally:
                flooding.cancel()


def test_only_a_valid_camera_pose_is_forwarded() -> None:
    encode = msgspec.msgpack.encode
    assert passes(encode(CAMERA))
    for kind in (
        "ShareUrlRequest",
        "ShareUrlDisconnect",
        "FileTransferStartUpload",
        "GuiUpdateMessage",
    ):
        assert not passes(encode({"type": kind, "uuid": "x"}))
    for broken in (
        b"",
        b"\xc1",
        b"\x91" * 5000,
        encode("text"),
        encode([1]),
        encode({"kind": "x"}),
        encode({"type": 1}),
        encode({**CAMERA, "position": [1, 2]}),
        encode({**CAMERA, "fov": "wide"}),
        encode({"type": "ViewerCameraMessage"}),
    ):
        with pytest.raises(BadMessage):
            passes(broken)


@pytest.mark.parametrize("garbage", [b"\xc1\xc1", "text"])
async def test_garbage_closes_with_1007(served: Any, garbage: Any) -> None:
    await started(served)
    async with served.socket("/viewer", subprotocols=[PROTOCOL]) as socket:
        await socket.recv()
        await socket.send(garbage)
        with pytest.raises(ConnectionClosed):
            await read_on(socket)
        assert socket.close_code == 1007
    assert (await served.http.get("/api/status")).is_success


async def test_a_client_of_another_version_is_closed_with_1002(serve: Any, capsys: Any) -> None:
    async with serve(viewer=real_viewer) as served:
        await started(served)
        async with served.socket("/viewer", subprotocols=["viser-v0.0.1"]) as socket:
            with pytest.raises(ConnectionClosed):
                await socket.recv()
            assert socket.close_code == 1002
    capsys.readouterr()


async def test_without_viewer_everything_else_works(
    serve: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(**_: Any) -> Any:
        raise OSError("no port is left")

    monkeypatch.setattr(viser, "ViserServer", fail)

    async with serve(viewer=lambda s: start_viewer(s, points=500, rate_hz=10)) as served:
        door = served.app.state.viewer
        while "no port is left" not in str(door.viewer.trouble):
            await asyncio.sleep(0.01)
        page = await served.http.get("/viewer/")
        assert page.status_code == 503
        assert "no port is left" in page.text
        with pytest.raises(InvalidStatus) as refused:
            async with served.socket("/viewer", subprotocols=[PROTOCOL]):
                pass
        assert refused.value.response.status_code == 503
        assert (await served.http.get("/api/status")).is_success


async def test_a_dead_viewer_does_not_affect_the_server(served: Any) -> None:
    viewer = await started(served)
    async with served.socket("/viewer", subprotocols=[PROTOCOL]) as socket:
        await socket.recv()
        await asyncio.to_thread(viewer.stop)
        with pytest.raises(ConnectionClosed):
            await read_on(socket)
        assert socket.close_code == 1001
    with pytest.raises(InvalidStatus) as refused:
        async with served.socket("/viewer", subprotocols=[PROTOCOL]):
            pass
    assert refused.value.response.status_code == 503
    assert (await served.http.get("/api/status")).is_success


async def test_a_slow_viewer_client_does_not_delay_others(served: Any, peer: Any) -> None:
    await started(served)
    slow = await served.socket("/viewer", subprotocols=[PROTOCOL])
    # It never reads again: its transport fills up, and viser waits for it alone.
    slow.transport.pause_reading()
    async with served.socket("/viewer", subprotocols=[PROTOCOL]) as quick:
        await quick.recv()
        until = time.monotonic() + 2
        messages = 0
        while time.monotonic() < until:
            peer.observe()
            async with asyncio.timeout(5):
                await quick.recv()
            messages += 1
        assert messages >= 10
    slow.transport.abort()
