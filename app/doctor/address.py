"""Check that the panel's address is free."""

from __future__ import annotations

import errno
import http.client
import json
import socket

from app.doctor.finding import Finding, Section
from app.settings import Settings, is_every_address

_SECTION = Section("Address")
_WAIT_S = 1.0
# Reply of /healthz.
_HEALTHY = {"status": "ok"}


def examine_address(settings: Settings) -> Finding:
    """Try to bind the port, then release it."""
    where = f"port {settings.port} of {settings.host}"
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            settings.host, settings.port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
    except socket.gaierror as error:
        return _SECTION.problem(
            f"there is no address {settings.host} to listen on ({error.strerror}); choose another "
            f"one with --host"
        )
    with socket.socket(family, kind, protocol) as probe:
        # Same as the server: ports of connections that just closed count as free.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(address)
        except OSError as error:
            return _taken(where, settings, error)
    return _SECTION.ok(f"{where} is free")


def _taken(where: str, settings: Settings, error: OSError) -> Finding:
    if error.errno == errno.EADDRINUSE:
        if _is_ours(settings):
            text = (
                f"{where} is in use, as it seems by Dynamic Observer itself; end it before another "
                f"start, or choose another port with --port"
            )
        else:
            text = f"{where} is in use by another program; choose another port with --port"
        return _SECTION.problem(text)
    return _SECTION.problem(
        f"{where} cannot be used ({error.strerror}); choose another one with --host or --port"
    )


def _is_ours(settings: Settings) -> bool:
    """Return whether this program answers at the address."""
    host = "127.0.0.1" if is_every_address(settings.host) else settings.host
    connection = http.client.HTTPConnection(host, settings.port, timeout=_WAIT_S)
    try:
        connection.request("GET", "/healthz")
        answer = connection.getresponse()
        return answer.status == http.client.OK and json.loads(answer.read(64)) == _HEALTHY
    except (OSError, ValueError, http.client.HTTPException):
        return False
    finally:
        connection.close()
