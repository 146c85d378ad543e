"""Serving: the socket, the printed link, uvicorn, and a clean shutdown."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import io
import logging
import os
import socket
import sys
import time
from collections.abc import Callable, Iterator
from typing import TextIO, cast

import structlog
import uvicorn
from fastapi import FastAPI

from app.addresses import ServerAddress, token_link
from app.client.announced import AnnouncedServer, announced
from app.contract.events import EngineState
from app.http.gate.strangers import GuardedListener, Strangers, guarded_protocol
from app.http.gate.token import load_token
from app.http.library_log import LibraryLog
from app.http.own_browser import open_page
from app.http.server import create_app
from app.http.socket_protocol import SocketProtocol
from app.runtime.endless import keep_running
from app.runtime.heap import keep_for_good
from app.server import Server
from app.settings import Settings
from app.storage.occupancy import occupied
from observer.errors import DynamicObserverError, InputError
from observer.opening import shown_spec

_EXIT_FAILED = 1
# Camera poses and acknowledgements are small; WebSockets receive nothing else.
_LARGEST_MESSAGE = 1024 * 1024
_SHUTDOWN_S = 2
_BACKLOG = 128
# Open files: viewers with several sockets each, plus files and unauthenticated connections.
_DESCRIPTORS = 16_384
# Seconds for opening the first source; a large data set is indexed first.
_OPENING_S = 90.0
_LOOK_EVERY_S = 0.05


def run(settings: Settings, *, browser: bool = False) -> int:
    """Serve until SIGINT or SIGTERM and return the process's exit code.

    Args:
        browser: whether to open the page on this computer's desktop once it is served.

    Raises:
        InputError: the port, a certificate or the token file cannot be used, or another server
            uses the data folder; one sentence.
        StorageError, ProcessUnavailable: the database or the engine cannot be used.
        StartRefused: the settings are strict, and something configured cannot be used.
    """
    # Only the owner may read recorded runs.
    os.umask(0o077)
    _configure_logging(settings.log_level)
    listener = _bind(settings)
    with contextlib.closing(listener), occupied(settings.data, settings.database):
        token = load_token(settings.token_file)
        app = create_app(settings, token)
        server = _Server(server_config(app, settings, listener.strangers))
        _use_all_descriptors()
        keep_for_good()
        port = listener.getsockname()[1]
        address = ServerAddress(settings.host, port, settings.tls, settings.allowed_hosts)
        links = app.state.admission.sessions.links

        def announcement() -> AnnouncedServer:
            return AnnouncedServer(
                host=address.host,
                port=port,
                tls=address.tls,
                allowed_hosts=address.allowed_hosts,
                token=token,
                read_only_token=links.newest.token,
            )

        with contextlib.ExitStack() as serving:

            def ready() -> None:
                tell = serving.enter_context(announced(settings.data, announcement()))
                links.changed = lambda: tell(announcement())
                _announce(address, token)
                if browser:
                    once = app.state.admission.guard.once()
                    open_page(token_link(address.here, once))

            asyncio.run(serve(app, server, listener, ready=ready, strict=settings.strict))
        return 0 if server.started else _EXIT_FAILED


async def serve(
    app: FastAPI,
    server: uvicorn.Server,
    listener: GuardedListener,
    *,
    ready: Callable[[], None] = lambda: None,
    strict: bool = False,
) -> None:
    """Start what the application owns, serve, and shut it all down.

    Args:
        ready: called once all that the application owns has started.
        strict: whether to end if anything that is configured cannot be used.

    Raises:
        StartRefused: with ``strict``; names all that cannot be used.

    uvicorn's own startup would turn a one-sentence error into a traceback.
    """
    async with app.router.lifespan_context(app):
        if strict:
            await _check_configuration(app.state.server)
        ready()
        # Only while strangers' connections are swept does Stop stay reachable.
        sweeping = keep_running(listener.strangers.watch, "sweep of strangers' connections")
        watching = asyncio.create_task(sweeping)
        try:
            await server.serve(sockets=[listener])
        finally:
            watching.cancel()


class StartRefused(DynamicObserverError):
    """Refusal to serve with a configuration that cannot be used as it is."""


async def _check_configuration(server: Server) -> None:
    """Wait until the first source is open; raise StartRefused if something cannot be used."""
    source = server.source
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(_OPENING_S):
            while source.state.state is EngineState.IDLE and source.to_calibrate is None:
                await asyncio.sleep(_LOOK_EVERY_S)
    problems = list(server.shared.warnings)
    if source.state.state in (EngineState.IDLE, EngineState.FAILED):
        late = f"it did not open within {_OPENING_S:g} s"
        why = "it has no calibration" if source.to_calibrate else source.state.reason or late
        problems.append(f"{shown_spec(source.wanted.source)} cannot be opened: {why}")
    if problems:
        raise StartRefused(
            f"{'; '.join(problems)}; correct this, or start without --strict to serve anyway"
        )


class _Server(uvicorn.Server):
    """uvicorn server that simply returns where the original would re-raise the signal."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        with super().capture_signals():
            yield
            # A signal is the normal end of serving; there is nothing left to signal.
            self._captured_signals.clear()


def server_config(app: FastAPI, settings: Settings, strangers: Strangers) -> uvicorn.Config:
    """Return uvicorn's configuration for the application.

    Raises:
        InputError: the certificate or its key cannot be used.
    """
    try:
        config = uvicorn.Config(
            app,
            http=guarded_protocol(strangers),
            backlog=_BACKLOG,
            ws=SocketProtocol,
            # With compression, five viewers of 50000 points use 85 % of a core; without it 2 %.
            ws_per_message_deflate=False,
            ws_max_size=_LARGEST_MESSAGE,
            ws_ping_interval=20.0,
            ws_ping_timeout=20.0,
            lifespan="off",
            # Links contain the token, so requests are not logged.
            access_log=False,
            log_config=None,
            log_level=settings.log_level,
            # No proxy is trusted to name the client.
            proxy_headers=False,
            server_header=False,
            timeout_graceful_shutdown=_SHUTDOWN_S,
            ssl_certfile=settings.tls_cert,
            ssl_keyfile=settings.tls_key,
        )
        config.load()
    except OSError as error:
        # ssl.SSLError is a subclass.
        raise InputError(
            f"the certificate {settings.tls_cert} with the key {settings.tls_key} cannot be used "
            f"({error.strerror or error}); --tls-cert and --tls-key must be matching PEM files"
        ) from error
    return config


def _use_all_descriptors() -> None:
    """Raise the limit on open files where the system allows it."""
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        now, most = resource.getrlimit(resource.RLIMIT_NOFILE)
        if now < _DESCRIPTORS:
            enough = _DESCRIPTORS if most == resource.RLIM_INFINITY else min(most, _DESCRIPTORS)
            resource.setrlimit(resource.RLIMIT_NOFILE, (enough, most))


def _bind(settings: Settings) -> GuardedListener:
    """Return the listening socket, bound before anything is started."""
    try:
        family, _, _, _, address = socket.getaddrinfo(
            settings.host, settings.port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
    except socket.gaierror as error:
        raise InputError(
            f"there is no address {settings.host} to listen on ({error.strerror}); --host must be "
            "an address of this computer"
        ) from error
    listener = GuardedListener(Strangers(time.monotonic), family)
    try:
        if sys.platform != "win32":
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(_BACKLOG)
    except OSError as error:
        listener.close()
        raise InputError(_refusal(settings, error)) from error
    return listener


def _refusal(settings: Settings, error: OSError) -> str:
    where = f"port {settings.port} of {settings.host}"
    if error.errno == errno.EADDRINUSE:
        return f"{where} is in use by another program; choose another one with --port"
    if error.errno in (errno.EACCES, errno.EPERM):
        return f"using {where} needs special permissions; choose another one with --port"
    if error.errno == errno.EADDRNOTAVAIL:
        return f"{settings.host} is not an address of this computer; choose another one with --host"
    return f"{where} cannot be used ({error.strerror}); choose another one with --port or --host"


def _announce(address: ServerAddress, token: str) -> None:
    """Print the links for the person who started the server: to a terminal, a file or a pipe."""
    lines = [f"Dynamic Observer is at {token_link(address.here, token)}"]
    if address.elsewhere:
        lines.append(f"From other computers: {token_link(address.elsewhere[0], token)}")
        lines.append("Run dynamic-observer link for all links, read-only ones too, and a QR code.")
    lines.append("Press Ctrl-C to stop it.")
    print(*lines, sep="\n", flush=True)  # noqa: T201


class _Lasting(io.TextIOBase):
    """Log stream that drops what cannot be written (a full disk): no work fails for a log line."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        with contextlib.suppress(OSError):
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        with contextlib.suppress(OSError):
            self._stream.flush()


def _configure_logging(level: str) -> None:
    """Log one line per event to stderr, for our code and for libraries."""
    number = logging.getLevelNamesMapping()[level.upper()]
    handler = logging.StreamHandler()
    handler.addFilter(LibraryLog(time.monotonic))
    logging.basicConfig(
        level=number, format="%(levelname)s %(name)s: %(message)s", handlers=[handler]
    )
    structlog.configure(
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso"),
            structlog.processors.format_exc_info,
            structlog.processors.KeyValueRenderer(key_order=["timestamp", "level", "event"]),
        ],
        wrapper_class=structlog.make_filtering_bound_logger(number),
        logger_factory=structlog.PrintLoggerFactory(cast("TextIO", _Lasting(sys.stderr))),
        cache_logger_on_first_use=True,
    )
