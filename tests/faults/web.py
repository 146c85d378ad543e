"""Clients that do what no browser does, and measuring what that costs the server."""

from __future__ import annotations

import contextlib
import select
import socket
import threading
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import httpx
import psutil
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from observer.calibration.formats.opencv_file import calibration_text
from observer.camera import StereoCalibration

from .bench import Server, tell
from .results import keep

MEGABYTE = 1 << 20
CANARY = "a canary that nobody may read"
SOCKETS = ("/api/live", "/api/drive", "/api/views/left", "/viewer")
_ACTS = {"post", "put", "patch", "delete"}
_LONGEST_HEAD = 64 * 1024
_SAMPLE_S = 0.01
_PATIENCE_S = 15.0
_IN_PATHS = {"id": "some-id", "name": "left", "role": "observer", "kind": "opencv"} | {
    "side": "left", "format": "svg", "position": "0", "number": "1",
}  # fmt: skip
_CALIBRATION = StereoCalibration.rectified(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)


@dataclass(frozen=True)
class Operation:
    """An operation in the API's description.

    Attributes:
        path: with a value for each of its parameters. described: its entry in the description.
    """

    method: str
    path: str
    described: dict[str, Any]

    @property
    def acts(self) -> bool:
        return self.method.lower() in _ACTS

    @property
    def takes_json(self) -> bool:
        return "application/json" in self.described.get("requestBody", {}).get("content", {})


class Web:
    """The server as seen from its port.

    Args:
        server: a running one.

    Attributes:
        http: a client that is signed in and keeps its connections. stranger: one not signed in.
        calibration: id of a stored one.
        description: the OpenAPI document. operations: all operations in it.
    """

    def __init__(self, server: Server) -> None:
        self.server = server
        address = f"http://127.0.0.1:{server.port}"
        self.http = httpx.Client(
            base_url=address,
            headers={"Authorization": f"Bearer {server.token}"},
            timeout=20,
            trust_env=False,
        )
        self.stranger = httpx.Client(base_url=address, timeout=20, trust_env=False)
        file = {"file": ("calibration.yaml", calibration_text(_CALIBRATION))}
        self.calibration = self.http.post("/api/calibrations", files=file).json()["id"]
        self.description = self.http.get("/openapi.json").json()
        self.operations = [
            Operation(method.upper(), self._concrete(path), described)
            for path, operations in self.description["paths"].items()
            for method, described in operations.items()
        ]

    def _concrete(self, path: str) -> str:
        known = {"id": self.calibration} if path.startswith("/api/calibrations/") else {}
        return path.format(**{**_IN_PATHS, **known})

    def close(self) -> None:
        self.http.close()
        self.stranger.close()

    def head(self, method: str, path: str, *lines: str, signed_in: bool = True) -> bytes:
        """Return a request up to its body."""
        host = [f"Host: 127.0.0.1:{self.server.port}"]
        if any(line.startswith("Host:") for line in lines):
            host = []
        token = [f"Authorization: Bearer {self.server.token}"] if signed_in else []
        return "\r\n".join([f"{method} {path} HTTP/1.1", *host, *token, *lines, "", ""]).encode(
            "latin-1"
        )

    def connected(self) -> socket.socket:
        connection = socket.create_connection(("127.0.0.1", self.server.port), _PATIENCE_S)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return connection

    def answer(self, sent: bytes) -> tuple[int, bytes]:
        """Send raw bytes; return status and beginning of the answer."""
        with self.connected() as connection:
            connection.sendall(sent)
            return read_answer(connection)

    def handshake(self, path: str, *lines: str, signed_in: bool = True) -> bytes:
        """Return a request that opens a WebSocket."""
        return self.head(
            "GET",
            path,
            *("Connection: Upgrade", "Upgrade: websocket", "Sec-WebSocket-Version: 13"),
            *("Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", *lines),
            signed_in=signed_in,
        )

    def opened(self, path: str) -> ClientConnection:
        """Return an open WebSocket that is signed in."""
        protocol: Any = ["viser-v1.1.1"] if path == "/viewer" else None
        return connect(
            f"ws://127.0.0.1:{self.server.port}{path}",
            additional_headers={"Authorization": f"Bearer {self.server.token}"},
            subprotocols=protocol,
            compression=None,
            max_size=None,
            proxy=None,
            close_timeout=2,
        )

    @contextlib.contextmanager
    def slow_client(self, path: str) -> Iterator[None]:
        """Open a WebSocket and never read from it."""
        line = ["Sec-WebSocket-Protocol: viser-v1.1.1"] if path == "/viewer" else []
        with socket.socket() as connection:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            connection.settimeout(_PATIENCE_S)
            connection.connect(("127.0.0.1", self.server.port))
            connection.sendall(self.handshake(path, *line))
            assert connection.recv(12) == b"HTTP/1.1 101"
            yield

    def upload(self, path: str, first: bytes, length: int, *, announced: bool) -> tuple[int, int]:
        """Send a body of ``length`` bytes until an answer comes; return status and bytes sent.

        Args:
            first: beginning of the body. announced: whether by Content-Length.
        """
        size = f"Content-Length: {length}" if announced else "Transfer-Encoding: chunked"
        kind = "Content-Type: multipart/form-data; boundary=x" if first else _JSON
        block = bytes(1 << 16)
        chunk = block if announced else b"10000\r\n" + block + b"\r\n"
        beginning = first if announced or not first else b"%x\r\n%b\r\n" % (len(first), first)
        with self.connected() as connection:
            connection.sendall(self.head("POST", path, size, kind) + beginning)
            sent = 0
            with contextlib.suppress(ConnectionError):
                while sent < length and not select.select([connection], [], [], 0)[0]:
                    connection.sendall(chunk)
                    sent += len(block)
            return read_answer(connection)[0], sent


_JSON = "Content-Type: application/json"


def read_answer(connection: socket.socket) -> tuple[int, bytes]:
    """Return status and beginning of an answer; status 0 if the connection ends without one."""
    data = b""
    with contextlib.suppress(ConnectionError):
        while b"\r\n\r\n" not in data and len(data) < _LONGEST_HEAD:
            part = connection.recv(4096)
            if not part:
                break
            data += part
        connection.settimeout(0.05)
        with contextlib.suppress(TimeoutError):
            data += connection.recv(_LONGEST_HEAD)
    status = data.split(b" ", 2)[1:2]
    return (int(status[0]) if status else 0), data


class Memory:
    """Measures the growth of a process and the new processes it starts; a context manager.

    Attributes:
        grown: largest growth, bytes.
    """

    def __init__(self, process: psutil.Process) -> None:
        self._process = process
        self._others = set(process.children(recursive=True))
        self._before = process.memory_info().rss
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="memory")
        self.grown = 0

    def __enter__(self) -> Memory:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._thread.join()

    def _watch(self) -> None:
        round_ = 0
        while not self._ends.wait(_SAMPLE_S):
            held = self._process.memory_info().rss - self._before
            # Looking for new processes takes a while.
            if round_ % 20 == 0:
                new = set(self._process.children(recursive=True)) - self._others
            for each in new:
                with contextlib.suppress(psutil.NoSuchProcess):
                    held += each.memory_info().rss
            self.grown = max(self.grown, held)
            round_ += 1

    @property
    def told(self) -> str:
        return f"{self.grown / MEGABYTE:.1f} MB"


class Watcher(threading.Thread):
    """A page that accepts everything it is sent at once.

    Attributes:
        count: of images or observations so far.
    """

    def __init__(self, web: Web, path: str) -> None:
        super().__init__(name=f"watches {path}")
        self.count = 0
        self._socket = web.opened(path)
        self.start()

    def run(self) -> None:
        with contextlib.suppress(ConnectionClosed):
            for message in self._socket:
                if isinstance(message, bytes):
                    self._socket.send("ack")
                    self.count += 1
                elif '"type":"observation"' in message[:100]:
                    number = message.partition('"sequence":')[2].partition(",")[0]
                    self._socket.send(f'{{"type": "painted", "sequence": {number}}}')
                    self.count += 1

    def end(self) -> None:
        self._socket.close()
        self.join(5)


@dataclass(frozen=True)
class Delivery:
    """What arrives at watchers. per_s: messages at each. share: of the frames observed."""

    per_s: float
    share: float


def delivery(web: Web, watchers: Iterable[Watcher], frames: int) -> Delivery:
    """Measure what arrives at watchers while this many frames are observed."""
    all_of_them = list(watchers)

    def arrived_and_observed() -> tuple[float, int]:
        arrived = sum(each.count for each in all_of_them) / len(all_of_them)
        return arrived, web.http.get("/api/status").json()["frames_observed"]

    started = time.monotonic()
    before = after = arrived_and_observed()
    while after[1] < before[1] + frames and time.monotonic() < started + _PATIENCE_S:
        time.sleep(0.1)
        after = arrived_and_observed()
    arrived, observed = after[0] - before[0], after[1] - before[1]
    return Delivery(arrived / (time.monotonic() - started), arrived / max(1, observed))


# --- invariants and reports ---------------------------------------------------------------------


def living(web: Web) -> dict[str, Any]:
    """Return the PIDs of the serving processes."""
    status = web.http.get("/api/status").json()["engine"]
    drive = web.http.get("/api/robots").json()["process"]
    return {"web": web.server.process.pid, "engine": status["pid"], "drive": drive["pid"]}


def state_of(web: Web) -> dict[str, Any]:
    """Return everything that a request could change, except what changes by itself."""
    robots = web.http.get("/api/robots").json()
    moving = {
        role: robot and {key: robot[key] for key in ("state", "operator", "commanded", "sent")}
        for role, robot in robots["robots"].items()
    }
    lists = ("runs", "presets", "calibrations", "truth", "programmes", "recording/clips", "rig")
    return {
        "stopped": robots["stopped"],
        "robots": moving,
        "parameters": web.http.get("/api/parameters").json()["values"],
        "source": web.http.get("/api/status").json()["source"],
        **{each: web.http.get(f"/api/{each}").json() for each in lists},
    }


@contextlib.contextmanager
def nothing_changes(web: Web) -> Iterator[None]:
    """Fail if anything has changed afterwards."""
    before = state_of(web)
    yield
    assert state_of(web) == before


def told(number: int, name: str, sentence: str, **figures: Any) -> None:
    """Print a result and store its figures."""
    tell(f"fault {number:2}, {name}: {sentence}")
    keep(number, name, **figures)


def listed(counted: Counter[int]) -> str:
    """Return the numbers and how often each occurred, in words."""
    return ", ".join(f"{number} ({times})" for number, times in sorted(counted.items()))


def close_code(connection: socket.socket) -> int:
    """Return the code with which the server closes a WebSocket, after anything else; 0: none."""
    data = b""
    with contextlib.suppress(ConnectionError, TimeoutError):
        while part := connection.recv(1 << 16):
            data += part
    # The last frame is the close frame: 0x88, its length, the code.
    at = data.rfind(b"\x88")
    return int.from_bytes(data[at + 2 : at + 4], "big") if at >= 0 else 0
