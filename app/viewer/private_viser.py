"""viser on loopback, for our proxy alone.

viser has no authentication, and every user of the machine, and every web page in a browser there,
can reach a port on loopback. So the proxy shows a secret at the handshake; all others are refused.
"""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from http import HTTPStatus
from typing import Any

import structlog
import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

log = structlog.get_logger(__name__)

_HEADER = "X-Dynamic-Observer-Viewer"


class PrivateViser:
    """viser server that admits only clients that send ``headers``.

    Attributes:
        server: viser's own. port: on 127.0.0.1. headers: to send with the handshake.

    Raises:
        RuntimeError: this version of viser cannot be kept private.
    """

    def __init__(self) -> None:
        secret = secrets.token_urlsafe(32)
        self.headers = {_HEADER: secret}
        with quiet(), _guarded(secret) as guards:
            self.server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        # Otherwise any client could have viser open a public tunnel to this machine.
        self.server.request_share_url = _refuse_sharing  # type: ignore[method-assign]
        self.port = self.server.get_port()
        if not guards:
            self.stop()
            raise RuntimeError("this version of viser cannot be restricted to signed-in users")

    def stop(self) -> None:
        """End its threads and sockets."""
        with quiet():
            self.server.stop()


@contextmanager
def _guarded(secret: str) -> Iterator[list[str]]:
    """Make WebSocket servers started meanwhile require the secret; yield the guarded addresses.

    viser has no setting for this, and starts its server in a thread before its constructor returns.
    """
    serve = websockets.asyncio.server.serve
    guarded: list[str] = []

    def guarded_serve(handler: Any, host: str, port: int, **more: Any) -> Any:
        answer = more.pop("process_request", None)

        def admit(connection: ServerConnection, request: Request) -> Response | None:
            shown = request.headers.get_all(_HEADER)
            if len(shown) != 1 or not hmac.compare_digest(shown[0].encode(), secret.encode()):
                return connection.respond(HTTPStatus.FORBIDDEN, "open the viewer in the panel\n")
            return None if answer is None else answer(connection, request)

        guarded.append(f"{host}:{port}")
        return serve(handler, host, port, process_request=admit, **more)

    websockets.asyncio.server.serve = guarded_serve  # type: ignore[misc, assignment]
    try:
        yield guarded
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[misc]


def _refuse_sharing(*_: object, **__: object) -> None:
    log.warning("share_request_refused")


@contextmanager
def quiet() -> Iterator[None]:
    """Silence viser's announcement on rich's shared console, which is for our own output only."""
    import rich

    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before
