"""The application behind a real uvicorn on a free port, in the test's own event loop."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
import uvicorn
from pydantic import TypeAdapter
from websockets.asyncio.client import ClientConnection, connect

from app.contract.events import EngineState
from app.http import run_server
from app.http.gate.strangers import GuardedListener, Strangers
from app.http.run_server import server_config
from app.http.server import create_app
from app.server import Server
from app.settings import Settings
from app.storage import Storage
from app.viewer import NullViewer
from observer.robots.contract import RobotPort

from ...waiting import until_async

# Where FastAPI creates the objects that read and write a route's values.
_ADAPTERS = "fastapi._compat.v2.TypeAdapter"
TOKEN = "a-token-of-the-tests-with-256-bits-more-or-less"


class _Server(uvicorn.Server):
    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        # Signals belong to pytest.
        yield


@dataclass(frozen=True)
class Served:
    """A running server and clients that send the token."""

    app: Any
    server: Server
    port: int
    http: httpx.AsyncClient
    strangers: Strangers

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def anonymous(self, **headers: str) -> httpx.AsyncClient:
        """A client without the token."""
        return _client(self.url, headers)

    def socket(
        self, path: str, *, token: str | None = TOKEN, headers: Any = (), **more: Any
    ) -> AbstractAsyncContextManager[ClientConnection]:
        sent = list(dict(headers).items())
        if token is not None:
            sent.append(("Authorization", f"Bearer {token}"))
        return connect(
            f"ws://127.0.0.1:{self.port}{path}",
            additional_headers=sent,
            compression=None,
            max_size=None,
            proxy=None,
            open_timeout=20,
            close_timeout=2,
            **more,
        )


def _client(url: str, headers: dict[str, str]) -> httpx.AsyncClient:
    """Return a client without TLS, which would load all authorities' certificates each time."""
    return httpx.AsyncClient(
        base_url=url, headers=headers, timeout=20, trust_env=False, verify=False
    )


ServedFactory = Callable[..., AbstractAsyncContextManager[Served]]


@asynccontextmanager
async def serving(app: Any, settings: Settings) -> AsyncIterator[Served]:
    with GuardedListener(Strangers(time.monotonic)) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        port = listener.getsockname()[1]
        server = _Server(server_config(app, settings, listener.strangers))
        task = asyncio.create_task(run_server.serve(app, server, listener))
        while not server.started:
            if task.done():
                await task
                raise RuntimeError("the server did not start")
            await asyncio.sleep(0.01)
        headers = {"Authorization": f"Bearer {TOKEN}"}
        client = _client(f"http://127.0.0.1:{port}", headers)
        try:
            async with client:
                # The first source is opened after the start.
                while app.state.server.source.state.state is EngineState.IDLE:
                    await asyncio.sleep(0.01)
                yield Served(app, app.state.server, port, client, listener.strangers)
        finally:
            server.should_exit = True
            await task


@pytest.fixture(scope="session", autouse=True)
def _routes_typed_once() -> Iterator[None]:
    """Share the type adapters of routes between all applications of a test process.

    They take nine tenths of the time to make an application, and depend only on the type and its
    metadata. Types are compared as well, since two of one name are written alike.
    """
    kept: dict[tuple[Any, str, str], TypeAdapter[Any]] = {}

    def made_once(annotated: Any, *, config: Any = None) -> TypeAdapter[Any]:
        key = (annotated.__origin__, repr(annotated), repr(config))
        if key not in kept:
            kept[key] = TypeAdapter(annotated, config=config)
        return kept[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_ADAPTERS, made_once)
        yield


@pytest.fixture
def token() -> str:
    return TOKEN


@pytest.fixture
def serve(tmp_path: Path, peer: Any, drive: Any, storage: Storage) -> ServedFactory:
    """``async with serve() as served``; keyword arguments are settings."""

    def make(*, viewer: Any = None, **settings: Any) -> AbstractAsyncContextManager[Served]:
        chosen = Settings(data=tmp_path, **settings)
        app = create_app(
            chosen,
            TOKEN,
            engine=peer,
            drive=drive,
            storage=storage,
            viewer=viewer or (lambda _: NullViewer("not in this test")),
        )
        return serving(app, chosen)

    return make


@pytest.fixture
async def served(serve: ServedFactory) -> AsyncIterator[Served]:
    """The application with the settings it has unless told otherwise."""
    async with serve() as served:
        yield served


@pytest.fixture
def http(served: Served) -> httpx.AsyncClient:
    """The client of ``served`` that sends the token."""
    return served.http


@pytest.fixture
def serve_app() -> Callable[[Any, Settings], AbstractAsyncContextManager[Served]]:
    """Serve an application that the test assembled itself."""
    return serving


@pytest.fixture
def eventually() -> Callable[..., Any]:
    """Wait until something holds, with a deadline that only a fault can reach."""
    return until_async


@pytest.fixture
def world(peer: Any) -> None:
    """The source that opens next is a simulated world with one robot."""
    peer.world = "simulated:lab/1"
    peer.robots = (
        RobotPort("observer", "socket://127.0.0.1:5001", "amigo-sh", "the cameras' robot"),
    )


@pytest.fixture
async def connected(world: None, served: Any, drive: Any, eventually: Any) -> None:  # noqa: ARG001
    """The server has connected the world's robot."""
    await eventually(lambda: drive.robots)
