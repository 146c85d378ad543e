"""Where a simulator listens, from the text that names it."""

from __future__ import annotations

from dataclasses import dataclass

from observer.errors import InputError, SourceError

DEFAULT_HOST = "127.0.0.1"
# Where the simulator's server listens unless its own settings say otherwise.
DEFAULT_PORT = 23000
_SCHEME = "coppeliasim:"


@dataclass(frozen=True)
class Address:
    """A simulator's server."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"

    @property
    def world(self) -> str:
        """The text that opens it as a source; names its world as well."""
        return f"{_SCHEME}{self}"


def parse_address(text: str) -> Address:
    """``HOST:PORT``, ``HOST`` or nothing: the simulator on this machine, at its usual port.

    Raises:
        SourceError: it is none of these.
    """
    host, colon, port = text.strip().rpartition(":")
    if not colon:
        host, port = port, str(DEFAULT_PORT)
    if not (port.isascii() and port.isdecimal() and 0 < int(port) < 65536):
        raise SourceError(
            f"{_SCHEME}{text} names no port of 1 to 65535; "
            f"give coppeliasim:HOST:PORT, as in {Address(DEFAULT_HOST, DEFAULT_PORT).world}"
        )
    host = host or DEFAULT_HOST
    if any(c.isspace() or c in ":/" for c in host):
        raise SourceError(
            f"{_SCHEME}{text} names no host; "
            f"give coppeliasim:HOST:PORT, as in {Address(DEFAULT_HOST, DEFAULT_PORT).world}"
        )
    return Address(host, int(port))


def parse_robot(spec: str) -> tuple[Address, str]:
    """The simulator and the robot's path in its scene, of ``coppeliasim:HOST:PORT/PATH``.

    Raises:
        InputError: it names no path, or no simulator.
    """
    if not spec.lower().startswith(_SCHEME):
        raise InputError(f"{spec} is no robot of CoppeliaSim; give coppeliasim:HOST:PORT/PATH")
    address, slash, path = spec[len(_SCHEME) :].partition("/")
    if not path:
        raise InputError(
            f"{spec} names no robot; add its path in the scene, as in "
            f"{Address(DEFAULT_HOST, DEFAULT_PORT).world}/PioneerP3DX"
        )
    return parse_address(address), slash + path
