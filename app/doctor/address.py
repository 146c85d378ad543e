"""Check whether the panel's address is free, who uses it otherwise, and how it is reached."""

from __future__ import annotations

import errno
import http.client
import json
import socket
from collections.abc import Iterator

from app.addresses import ServerAddress
from app.client.announced import AnnouncedServer, find_server
from app.doctor.finding import Finding, Section
from app.settings import Settings, is_every_address
from observer.errors import InputError

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
    return _SECTION.ok(f"{where} is free", tuple(_reached(_address(settings))))


def _address(settings: Settings) -> ServerAddress:
    return ServerAddress(settings.host, settings.port, settings.tls, settings.allowed_hosts)


def _reached(address: ServerAddress) -> Iterator[str]:
    """Yield where a server at the address is reached."""
    yield f"from this computer at {address.here}"
    if address.elsewhere:
        yield f"from other computers at {', '.join(address.elsewhere)}"
    else:
        yield "not reachable from other computers; start it with --host 0.0.0.0 to allow them"


def _taken(where: str, settings: Settings, error: OSError) -> Finding:
    if error.errno != errno.EADDRINUSE:
        return _SECTION.problem(
            f"{where} cannot be used ({error.strerror}); choose another one with --host or --port"
        )
    listener = _listener(settings.port)
    running = _running(settings)
    if running is None and not _is_ours(settings):
        other = listener or "another program"
        return _SECTION.problem(f"{where} is in use by {other}; choose another port with --port")
    return _SECTION.problem(
        f"{where} is in use by a running Dynamic Observer{f' ({listener})' if listener else ''}; "
        f"stop it first, or choose another port with --port",
        ()
        if running is None
        else (*_reached(running.address), "run dynamic-observer link to see its links"),
    )


def _running(settings: Settings) -> AnnouncedServer | None:
    """Return the server of this data folder if it is the one at the port."""
    try:
        found = find_server(settings.data)
    except InputError:
        return None
    return found if found.port == settings.port else None


def _listener(port: int) -> str | None:
    """Return the program that listens at a port; None where it belongs to another user."""
    import psutil

    try:
        connections = psutil.net_connections("tcp")
    except (psutil.Error, OSError):
        return None
    listening = (each for each in connections if each.status == psutil.CONN_LISTEN)
    pid = next((each.pid for each in listening if each.laddr and each.laddr.port == port), None)
    if pid is None:
        return None
    try:
        return f"{psutil.Process(pid).name()}, process {pid}"
    except psutil.Error:
        return f"process {pid}"


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
