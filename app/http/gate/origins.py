"""Which names the server answers to, and whose pages may speak to it: pure functions of text."""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass
from urllib.parse import urlsplit

_LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})
_DEFAULT_PORTS = {"http": 80, "https": 443}
_HOST = re.compile(
    r"(?:\[(?P<six>[0-9a-f:.]+)\]|(?P<name>[a-z0-9_](?:[a-z0-9_.-]*[a-z0-9_])?))"
    r"(?::(?P<port>[0-9]{1,5}))?"
)
_LONGEST = 255


@dataclass(frozen=True)
class NetworkName:
    """A host name or address, in lower case and without brackets, and the port if one was given."""

    name: str
    port: int | None


def parse_host(text: str) -> NetworkName | None:
    """A ``Host`` header's value; None where it is none."""
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

    A rebound DNS name carries the attacker's name in ``Host``, so a list of names ends the attack
    (and no other check of the request does).

    Attributes:
        own: any port. with_port: names that were allowed with one port only.
        explicit: what the person at the server named by ``--allowed-host``.
        tls: whether the server itself speaks https.
    """

    own: frozenset[str]
    with_port: frozenset[NetworkName]
    explicit: frozenset[str]
    tls: bool

    def answers_to(self, host: NetworkName) -> bool:
        """Whether a request for this ``Host`` is meant for this server."""
        return host.name in self.own or host in self.with_port

    def accepts_origin(self, origin: str, host: NetworkName) -> bool:
        """Whether a page of ``origin`` may speak to the server that it addressed as ``host``.

        Its own pages may. So may those of an explicitly allowed name on the standard ports: a
        reverse proxy in front may have replaced ``Host``.
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


def names_of(bound_to: str, allowed_hosts: tuple[str, ...], *, tls: bool) -> Names:
    """The names of a server that listens on ``bound_to`` and was told of further ones."""
    own = set(_LOOPBACK)
    bound = bound_to.lower().strip("[]")
    if not _is_wildcard(bound):
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
    return Names(frozenset(own), frozenset(with_port), frozenset(explicit), tls)


def _is_wildcard(address: str) -> bool:
    try:
        return ipaddress.ip_address(address).is_unspecified
    except ValueError:
        return False
