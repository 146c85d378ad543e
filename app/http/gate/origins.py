"""Names that the server answers to, and origins that may call it: pure functions of text."""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass
from urllib.parse import urlsplit

from app.settings import is_every_address

_LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})
_DEFAULT_PORTS = {"http": 80, "https": 443}
_HOST = re.compile(
    r"(?:\[(?P<six>[0-9a-f:.]+)\]|(?P<name>[a-z0-9_](?:[a-z0-9_.-]*[a-z0-9_])?))"
    r"(?::(?P<port>[0-9]{1,5}))?"
)
_LONGEST = 255


@dataclass(frozen=True)
class NetworkName:
    """Host name or address, in lower case without brackets, and the port if one was given."""

    name: str
    port: int | None


def parse_host(text: str) -> NetworkName | None:
    """Parse the value of a ``Host`` header; return None if it is invalid."""
    match = _HOST.fullmatch(text.lower()) if len(text) <= _LONGEST else None
    if match is None:
        return None
    port = int(match["port"]) if match["port"] is not None else None
    if port is not None and port > 65535:
        return None
    return NetworkName(match["six"] or match["name"], port)


@dataclass(frozen=True)
class Names:
    """The names under which browsers may reach the server.

    DNS rebinding puts the attacker's name into ``Host``, so a list of names stops the attack (and
    no other check of the request does). An IP address such as 192.168.1.5 cannot be rebound: a page
    that has it in its address came from there.

    Attributes:
        own: allowed on any port. with_port: names allowed with one port only.
        numbers: whether it answers to every IP address, as a server listening on all of them does.
        explicit: names given by ``--allowed-host``.
        tls: whether the server itself speaks https.
    """

    own: frozenset[str]
    with_port: frozenset[NetworkName]
    explicit: frozenset[str]
    tls: bool
    numbers: bool = False

    def answers_to(self, host: NetworkName) -> bool:
        """Return whether a request for this ``Host`` is meant for this server."""
        if host.name in self.own or host in self.with_port:
            return True
        return self.numbers and _is_number(host.name)

    def accepts_origin(self, origin: str, host: NetworkName) -> bool:
        """Return whether a page of ``origin`` may call the server that it addressed as ``host``.

        The server's own pages may. So may pages of an explicitly allowed name on the standard
        ports: a reverse proxy may have replaced ``Host``.
        """
        try:
            parts = urlsplit(origin)
            page = parse_host(parts.netloc)
        except ValueError:
            return False
        if page is None or parts.scheme not in _DEFAULT_PORTS or parts.path or parts.query:
            return False
        if self.tls and parts.scheme != "https":
            return False
        default = _DEFAULT_PORTS[parts.scheme]
        port = page.port if page.port is not None else default
        if page.name == host.name and port == (host.port if host.port is not None else default):
            return True
        on_default = port == default and page.name in self.explicit
        return on_default or NetworkName(page.name, port) in self.with_port


def _is_number(name: str) -> bool:
    try:
        return not ipaddress.ip_address(name).is_unspecified
    except ValueError:
        return False


def names_of(bound_to: str, allowed_hosts: tuple[str, ...], *, tls: bool) -> Names:
    """Return the names of a server that listens on ``bound_to``, with the given further ones."""
    own = set(_LOOPBACK)
    bound = bound_to.lower().strip("[]")
    if not is_every_address(bound):
        own.add(bound)
    with_port = set()
    explicit = set()
    for text in allowed_hosts:
        host = parse_host(text) or parse_host(f"[{text}]")
        if host is None:
            continue
        if host.port is None:
            own.add(host.name)
            explicit.add(host.name)
        else:
            with_port.add(host)
    return Names(
        frozenset(own),
        frozenset(with_port),
        frozenset(explicit),
        tls,
        numbers=is_every_address(bound),
    )
