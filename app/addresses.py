"""Addresses at which a server is reached: from this computer, and from others in its network."""

from __future__ import annotations

import contextlib
import ipaddress
import socket
from dataclasses import dataclass
from pathlib import Path

from app.settings import is_every_address

ONLY_HERE = (
    "Only this computer can open these links, because the server listens on {host}. Start it with "
    "--host 0.0.0.0 to let others in."
)
# Interface prefixes of containers and virtual machines, which no other computer can reach.
_VIRTUAL = ("docker", "br-", "veth", "virbr", "podman", "cni", "lxc", "vmnet", "vboxnet", "bridge")
# Files written by Docker and by Podman, and the networks in which they place containers.
_CONTAINER_FILES = (Path("/.dockerenv"), Path("/run/.containerenv"))
_CONTAINER_NETWORKS = tuple(map(ipaddress.ip_network, ("172.16.0.0/12", "10.88.0.0/16")))
# Reserved for documentation: nothing is sent there, but the system names the source address.
_FAR = ((socket.AF_INET, "192.0.2.1"), (socket.AF_INET6, "2001:db8::1"))


def token_link(address: str, token: str) -> str:
    """Return the link that signs a browser in."""
    return f"{address}/?token={token}"


@dataclass(frozen=True)
class ServerAddress:
    """Address at which a server listens.

    Attributes:
        host: as bound, 0.0.0.0 or :: for every address. allowed_hosts: further names of the server.
        tls: whether it speaks https itself.
    """

    host: str
    port: int
    tls: bool = False
    allowed_hosts: tuple[str, ...] = ()

    @property
    def here(self) -> str:
        """Return the address for this computer, as in ``http://localhost:8080``."""
        return self._url("localhost" if is_every_address(self.host) else self.host)

    @property
    def elsewhere(self) -> tuple[str, ...]:
        """Return the addresses for other computers, the likeliest first; empty if there are none.

        Names that the server was given come first: a certificate is for these.
        """
        named = [self._named(name) for name in self.allowed_hosts]
        if is_every_address(self.host):
            # A socket that listens on :: accepts IPv4 as well.
            both = ipaddress.ip_address(self.host).version == 6
            numbers = [each for each in network_addresses() if both or ":" not in each]
        else:
            numbers = [] if is_loopback(self.host) else [self.host]
        return tuple(dict.fromkeys([*named, *map(self._url, numbers)]))

    def _named(self, name: str) -> str:
        # A name allowed with a port says where a proxy listens.
        host, colon, port = name.rpartition(":")
        if colon and port.isdecimal() and ":" not in host:
            return self._url(host, int(port))
        return self._url(name)

    def _url(self, host: str, port: int | None = None) -> str:
        shown = f"[{host}]" if ":" in host else host
        return f"{'https' if self.tls else 'http'}://{shown}:{self.port if port is None else port}"


def is_loopback(host: str) -> bool:
    """Return whether a server there can be reached from the same computer only."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


def network_addresses() -> tuple[str, ...]:
    """Return this computer's addresses in its networks, IPv4 first, the likeliest first of each.

    Addresses of container bridges and link-local ones (valid on one cable only; browsers cannot
    open them) are left out; in a container also those of its own network, which are valid on its
    host only.
    """
    # Imported here: only sharing a link needs it.
    import psutil

    states = psutil.net_if_stats()
    found = [
        address.address
        for name, addresses in psutil.net_if_addrs().items()
        if not name.startswith(_VIRTUAL) and name in states and states[name].isup
        for address in addresses
        if address.family in (socket.AF_INET, socket.AF_INET6) and _is_usable(address.address)
    ]
    if any(file.exists() for file in _CONTAINER_FILES):
        found = [each for each in found if not _is_container_s(each)]
    likely = _outgoing()
    unique = dict.fromkeys(found)
    return tuple(sorted(unique, key=lambda a: (":" in a, a not in likely)))


def _is_usable(text: str) -> bool:
    try:
        address = ipaddress.ip_address(text)
    except ValueError:
        # With a zone, as in fe80::1%eth0.
        return False
    return not (address.is_loopback or address.is_link_local or address.is_unspecified)


def _is_container_s(text: str) -> bool:
    return any(ipaddress.ip_address(text) in network for network in _CONTAINER_NETWORKS)


def _outgoing() -> set[str]:
    """Return the addresses from which this computer reaches the world."""
    found = set()
    for family, far in _FAR:
        with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.connect((far, 9))
            found.add(str(probe.getsockname()[0]))
    return found
