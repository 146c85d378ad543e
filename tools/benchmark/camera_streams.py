"""Two network cameras of our own: a process that serves images as MJPEG over HTTP on loopback.

``python -m tools.benchmark.camera_streams FOLDER RATE`` serves the JPEG files ``left/*.jpg`` and
``right/*.jpg`` of a folder as ``/left`` and ``/right``, both by one clock, forwards and backwards
forever, so that the scene never jumps. It prints its port on stdout and ends when its stdin closes.
"""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from app.client.server_process import MeasurementError

SIDES = ("left", "right")
_BOUNDARY = "picture"
_START_TIMEOUT_S = 20.0
_STOP_TIMEOUT_S = 5.0


def to_and_fro(number: int, count: int) -> int:
    """Return the index of the image with this number among ``count``: 0 1 2 1 0 1 2 ..."""
    if count == 1:
        return 0
    place = number % (2 * count - 2)
    return min(place, 2 * count - 2 - place)


@contextmanager
def camera_streams(pictures: Path, rate: float) -> Iterator[tuple[str, str]]:
    """Serve a folder of images in a separate process; yield the addresses of left and right.

    Args:
        pictures: folder with ``left/*.jpg`` and ``right/*.jpg``. rate: images per second.

    Raises:
        MeasurementError: the process did not start, in time or at all.
    """
    process = subprocess.Popen(
        [sys.executable, "-m", "tools.benchmark.camera_streams", str(pictures), str(rate)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    patience = threading.Timer(_START_TIMEOUT_S, process.kill)
    patience.start()
    try:
        port = process.stdout.readline().strip()
        patience.cancel()
        if not port:
            raise MeasurementError("the process that serves camera streams did not come up")
        left, right = (f"http://127.0.0.1:{port}/{side}" for side in SIDES)
        yield left, right
    finally:
        patience.cancel()
        patience.join()
        process.stdin.close()
        try:
            process.wait(_STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stdout.close()


class _Streams(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, pictures: Mapping[str, Sequence[bytes]], rate: float) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.pictures = pictures
        self.rate = rate
        self.began = time.monotonic()

    def handle_error(self, request: object, client_address: object) -> None:
        """Ignore a client that leaves."""


class _Handler(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        assert isinstance(self.server, _Streams)
        streams = self.server
        pictures = streams.pictures.get(self.path.strip("/"))
        if pictures is None:
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Type", f"multipart/x-mixed-replace;boundary={_BOUNDARY}")
        self.end_headers()
        number = int((time.monotonic() - streams.began) * streams.rate) + 1
        while True:
            due = streams.began + number / streams.rate
            time.sleep(max(0.0, due - time.monotonic()))
            picture = pictures[to_and_fro(number, len(pictures))]
            head = f"--{_BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture)}"
            # Sent at once: a camera does not send an image in two parts either.
            self.wfile.write(head.encode() + b"\r\n\r\n" + picture + b"\r\n")
            number += 1

    def log_message(self, format: str, *args: object) -> None:
        """Print nothing: nobody reads it."""


def main() -> None:
    """Serve until stdin ends."""
    folder, rate = Path(sys.argv[1]), float(sys.argv[2])
    pictures = {
        side: [path.read_bytes() for path in sorted((folder / side).glob("*.jpg"))]
        for side in SIDES
    }
    if not all(pictures.values()):
        sys.exit(f"{folder} has no JPEG files for both cameras")
    streams = _Streams(pictures, rate)
    threading.Thread(target=streams.serve_forever, daemon=True).start()
    sys.stdout.write(f"{streams.server_port}\n")
    sys.stdout.flush()
    sys.stdin.read()


if __name__ == "__main__":
    main()
