"""The tokens that open the server, and the limit on guessing them."""

from __future__ import annotations

import hmac
import ipaddress
import os
import secrets
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable
from enum import Enum, auto
from pathlib import Path

from app.http.gate.read_only_links import ReadOnlyLink, ReadOnlyLinks, digest
from observer.errors import InputError

_TOKEN_BYTES = 32
# 128 bits in URL-safe base64.
_LEAST_CHARACTERS = 22
_MOST_CHARACTERS = 512
_WRONG_PER_WINDOW = 5
_WINDOW_S = 60.0
# Bounds the memory that many addresses can take; the oldest is forgotten first.
_MOST_ADDRESSES = 4096
# Seconds: the browser that the server opens sends its request sooner, even a slow one.
_ONCE_S = 60.0


def new_token() -> str:
    """Return 256 random bits as URL-safe text."""
    return secrets.token_urlsafe(_TOKEN_BYTES)


def load_token(path: Path | None) -> str:
    """Return the token for this start: read from the file, or created there if it does not exist.

    Raises:
        InputError: the file cannot be used or holds no safe token.
    """
    if path is None:
        return new_token()
    try:
        return _read_token(path)
    except FileNotFoundError:
        return _write_token(path)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            f"the token file {path} cannot be read ({error}); name a text file of your own"
        ) from error


def _read_token(path: Path) -> str:
    with path.open("rb") as file:
        token = file.read(_MOST_CHARACTERS + 2).decode("ascii").strip()
    plain = token.replace("-", "").replace("_", "").isalnum()
    if not plain or not _LEAST_CHARACTERS <= len(token) <= _MOST_CHARACTERS:
        raise InputError(
            f"the token file {path} must contain {_LEAST_CHARACTERS} to {_MOST_CHARACTERS} "
            "letters, digits, - or _ and nothing else; delete it to have a new token created"
        )
    return token


def _write_token(path: Path) -> str:
    token = new_token()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # Readable only by its owner from the first moment on.
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        try:
            with os.fdopen(descriptor, "w") as file:
                file.write(token + "\n")
        except OSError:
            # The next start would refuse an incomplete one.
            path.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise InputError(
            f"the token file {path} cannot be written ({error.strerror}); choose a writable folder"
        ) from error
    return token


class TokenVerdict(Enum):
    """Result of checking a request's tokens, where none of them is a read-only link's."""

    OPERATOR = auto()
    MISSING = auto()
    WRONG = auto()
    LIMITED = auto()


class TokenGuard:
    """Check of tokens in constant time, with a count of wrong ones per client address.

    The right token always works: nobody can lock the operator out by guessing.

    Args:
        token: the operators'. clock: monotonic seconds. links: the read-only ones.
    """

    def __init__(self, token: str, clock: Callable[[], float], links: ReadOnlyLinks) -> None:
        self._operator = digest(token)
        self._links = links
        self._clock = clock
        self._wrong: OrderedDict[str, deque[float]] = OrderedDict()
        self._once: tuple[bytes, float] | None = None

    def once(self) -> str:
        """Return an operators' token that works once, within a minute.

        It is for the link with which this computer's browser is opened: other users can see the
        command line of that process.
        """
        token = new_token()
        self._once = (digest(token), self._clock() + _ONCE_S)
        return token

    def check(self, address: str | None, candidates: Iterable[str]) -> TokenVerdict | ReadOnlyLink:
        """Check whether one of the tokens is right; the operators' takes precedence.

        For a read-only link's token, return that link.

        Args:
            address: the client's network address; None if there is none.
            candidates: the tokens of the request.
        """
        candidates = list(candidates)
        given = [digest(candidate) for candidate in candidates]
        # Every candidate is compared, so that the time does not reveal which one was right.
        operator = sum([hmac.compare_digest(each, self._operator) for each in given])
        read_only = self._links.find(candidates)
        if operator or self._is_once(given):
            return TokenVerdict.OPERATOR
        if read_only is not None:
            return read_only
        if not given:
            return TokenVerdict.MISSING
        return TokenVerdict.WRONG if self._count(_network(address)) else TokenVerdict.LIMITED

    def _is_once(self, given: list[bytes]) -> bool:
        """Return whether one of them is the one-time token, and use it up."""
        if self._once is None:
            return False
        once, until = self._once
        if not sum([hmac.compare_digest(each, once) for each in given]):
            return False
        self._once = None
        return self._clock() <= until

    def _count(self, network: str) -> bool:
        """Count one wrong token; return False if the network has used up its attempts."""
        now = self._clock()
        times = self._wrong.setdefault(network, deque())
        self._wrong.move_to_end(network)
        while len(self._wrong) > _MOST_ADDRESSES:
            self._wrong.popitem(last=False)
        while times and times[0] <= now - _WINDOW_S:
            times.popleft()
        if len(times) >= _WRONG_PER_WINDOW:
            return False
        times.append(now)
        return True


def _network(address: str | None) -> str:
    """Return the counting unit: an IPv4 address, or an IPv6 /64, whose holder has 2**64."""
    if address is None:
        return ""
    try:
        ip = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if ip.version == 6:
        if ip.ipv4_mapped is not None:
            return str(ip.ipv4_mapped)
        return str(ipaddress.ip_network((ip, 64), strict=False))
    return str(ip)
