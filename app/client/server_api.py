"""Client for the REST interface of a running server: one thread, one persistent connection."""

from __future__ import annotations

import http.client
import json
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlsplit

from observer.errors import DynamicObserverError, InputError

# Period of looking at the facts during a drive. They lag by up to a tenth of a second, more on a
# busy machine: what was started appears in them within the second time.
POLL_S, APPEARS_WITHIN_S = 0.1, 2.0
# Arming waits for a robot's answer; no request takes longer.
_TIMEOUT_S = 5.0
_LONGEST_TOKEN = 512
# These mean that the caller's request is wrong; anything else concerns the state of the server or
# of a robot. 404 may be either.
_WRONG_INPUT = (400, 401, 403, 413, 415, 422)


class DrivingFailed(DynamicObserverError):
    """Refusal by the server or a robot, or a lost link to them."""


class ServerApi:
    """Client for a server's REST interface; for one thread.

    Args:
        server: an address such as ``http://127.0.0.1:8080``; https works too.
        token: the token that the server printed at start-up or keeps in its token file.
        timeout_s: within which each request must be answered.

    Raises:
        InputError: the address is invalid.
    """

    def __init__(self, server: str, token: str, timeout_s: float = _TIMEOUT_S) -> None:
        parts = urlsplit(server if "//" in server else f"//{server}", scheme="http")
        try:
            port = parts.port
        except ValueError:
            port = -1
        if parts.scheme not in ("http", "https") or not parts.hostname or port == -1:
            raise InputError(
                f"{server[:80]!r} is not a server address; give one such as http://127.0.0.1:8080"
            )
        if parts.path.strip("/") or parts.query or parts.username:
            raise InputError(
                f"give only the address of the server, such as {parts.scheme}://{parts.hostname}"
            )
        self._tls = parts.scheme == "https"
        self._host, self._port = parts.hostname, port or (443 if self._tls else 80)
        self._timeout_s = timeout_s
        self._headers = {"Authorization": f"Bearer {token}"}
        self._connection: http.client.HTTPConnection | None = None

    @property
    def address(self) -> str:
        """Return the server's address without a path."""
        host = f"[{self._host}]" if ":" in self._host else self._host
        return f"{'https' if self._tls else 'http'}://{host}:{self._port}"

    @property
    def headers(self) -> dict[str, str]:
        """Return the headers that authenticate the operator."""
        return dict(self._headers)

    def socket_address(self, path: str) -> str:
        """Return the address of a WebSocket."""
        return f"ws{self.address.removeprefix('http')}{path}"

    def get(self, *path: str) -> Any:
        """Send a GET request and return the decoded reply; raise as ``request``."""
        return self.request("GET", *path)

    def post(self, *path: str, body: Any = None) -> Any:
        """Send a POST request and return the decoded reply; raise as ``request``."""
        return self.request("POST", *path, body={} if body is None else body)

    def delete(self, *path: str) -> Any:
        """Send a DELETE request and return the decoded reply; raise as ``request``."""
        return self.request("DELETE", *path)

    def request(self, method: str, *path: str, body: Any = None) -> Any:
        """Send one request.

        Args:
            path: the parts below ``/api``; this method quotes them.

        Returns:
            The decoded JSON of the reply; None if there is none.

        Raises:
            InputError: the server refused the request; the sentence is the server's.
            DrivingFailed: the server refused because of its state, is not there, or did not
                answer in time.
        """
        target = "/api/" + "/".join(quote(part, safe="") for part in path)
        headers = self._headers
        text = None
        if body is not None:
            headers = {**headers, "Content-Type": "application/json"}
            text = json.dumps(body, allow_nan=False)
        try:
            connection = self._connection or self._connect()
            connection.request(method, target, text, headers)
            answer = connection.getresponse()
            content = answer.read()
        except (OSError, http.client.HTTPException) as error:
            self.close()
            late = isinstance(error, TimeoutError)
            raise self.unanswered(f"for {self._timeout_s:g} s" if late else why(error)) from None
        except BaseException:
            # A late reply must not be taken for the reply to the next request.
            self.close()
            raise
        if answer.will_close:
            self.close()
        if answer.status < 300:
            return self._decoded(content) if content else None
        sentence = self._sentence(
            content, f"{method} {target} was answered with status {answer.status}"
        )
        unknown = answer.status == 404 and path[0] == "programmes"
        raise (InputError if unknown or answer.status in _WRONG_INPUT else DrivingFailed)(sentence)

    def unanswered(self, reason: str) -> DrivingFailed:
        """Return the failure of a server that cannot be reached."""
        return DrivingFailed(
            f"{self.address} does not answer ({reason}); start the server with "
            f"dynamic-observer serve, or name another one with --server"
        )

    def close(self) -> None:
        """Close the connection; the next request opens a new one."""
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.close()

    def _connect(self) -> http.client.HTTPConnection:
        kind = http.client.HTTPSConnection if self._tls else http.client.HTTPConnection
        self._connection = kind(self._host, self._port, timeout=self._timeout_s)
        return self._connection

    def _decoded(self, content: bytes) -> Any:
        try:
            return json.loads(content)
        except ValueError:
            raise DrivingFailed(
                f"{self.address} is not a Dynamic Observer server; give its address with --server"
            ) from None

    def _sentence(self, content: bytes, otherwise: str) -> str:
        try:
            detail = json.loads(content)["detail"]
        except (ValueError, KeyError, TypeError):
            return otherwise
        if isinstance(detail, str):
            return detail
        if not isinstance(detail, list):
            return otherwise
        problems = [each.get("msg") for each in detail if isinstance(each, dict)]
        sentences = [problem for problem in problems if isinstance(problem, str) and problem]
        return f"{otherwise}: {'; '.join(sentences)}" if sentences else otherwise


def read_token(token: str | None, file: Path | None) -> str:
    """Return the given token, or read it from the server's token file.

    Raises:
        InputError: neither or both are given, or the file cannot be read.
    """
    if token is not None and file is not None:
        raise InputError("give --token or --token-file, not both")
    if file is not None:
        try:
            token = file.read_bytes()[: _LONGEST_TOKEN + 2].decode("ascii").strip()
        except (OSError, UnicodeDecodeError):
            raise InputError(
                f"the token file {file} cannot be read; name the one the server was started with"
            ) from None
    if token is None:
        raise InputError(
            "a token is needed: --token-file FILE, as given to the server, or --token with the "
            "text after token= in the link it printed"
        )
    if not (0 < len(token) <= _LONGEST_TOKEN and token.isascii() and token.isprintable()):
        raise InputError("this is not a valid token; copy it from the link that the server printed")
    return token


def why(error: Exception) -> str:
    """Return the reason for a failed connection, in words."""
    return getattr(error, "strerror", None) or str(error) or type(error).__name__
