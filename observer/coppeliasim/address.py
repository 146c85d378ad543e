"""Addresses of simulators, parsed from the text that names them."""

from __future__ import annotations

import re
from dataclasses import dataclass

from observer.errors import InputError, SourceError

DEFAULT_HOST = "127.0.0.1"
# The simulator's own default.
DEFAULT_PORT = 23000
_SCHEME = "coppeliasim:"


@dataclass(frozen=True)
class Address:
    """The host and port of a simulator's server."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"

    @property
    def world(self) -> str:
        """The text that opens it as a source and names its world."""
        return f"{_SCHEME}{self}"


def parse_address(text: str) -> Address:
    """Parse ``HOST:PORT`` or ``HOST``; empty text means this machine at the default port.

    Raises:
        SourceError: the text has none of these forms.
    """
    right = f"give coppeliasim:HOST:PORT, as in {Address(DEFAULT_HOST, DEFAULT_PORT).world}"
    host, colon, port = text.strip().rpartition(":")
    if not colon:
        host, port = port, str(DEFAULT_PORT)
    if not (re.fullmatch(r"[0-9]{1,5}", port) and 0 < int(port) < 65536):
        raise SourceError(f"{_SCHEME}{text[:80]} must have a port from 1 to 65535; {right}")
    host = host or DEFAULT_HOST
    if any(c.isspace() or c in ":/" for c in host):
        raise SourceError(f"{_SCHEME}{text[:80]} has no host; {right}")
    return Address(host, int(port))


def parse_robot(spec: str) -> tuple[Address, str]:
    """Parse ``coppeliasim:HOST:PORT/PATH`` into the simulator and the robot's path in its scene.

    Raises:
        InputError: the text names no path or no simulator.
    """
    if not spec.lower().startswith(_SCHEME):
        raise InputError(f"{spec[:80]} is not a CoppeliaSim robot; give coppeliasim:HOST:PORT/PATH")
    address, slash, path = spec[len(_SCHEME) :].partition("/")
    if not path:
        raise InputError(
            f"{spec[:80]} names no robot; add its path in the scene, for example "
            f"{Address(DEFAULT_HOST, DEFAULT_PORT).world}/PioneerP3DX"
        )
    return parse_address(address), slash + path
