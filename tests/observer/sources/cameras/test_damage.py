"""Damaged streams of network cameras: images and one-sentence troubles, never a hang."""

from __future__ import annotations

import contextlib
import socketserver
import sys
import threading
import time
from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from hypothesis import example, given

from observer.errors import SourceError
from observer.sources.cameras.capture import NetworkCapture
from observer.sources.cameras.grabber import _MOST_MEMORY_BYTES
from observer.sources.cameras.source import CameraSource
from observer.sources.cameras.spec import parse_urls

from ....damage import (
    assert_one_sentence,
    damaged,
    damaged_text,
    examples,
    hostile_bytes,
    hostile_text,
    read_or_refused,
)
from .watching import Watch, grabbers

WIDTH, HEIGHT, PARTS = 64, 48, 8
HEAD = b"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace;boundary=b\r\n\r\n"
PIECES = (
    b"HTTP/1.1 302 Found\r\nLocation: /\r\n\r\n", b"Location: file:///etc/passwd\r\n",
    b"HTTP/1.1 401 No\r\nWWW-Authenticate: Basic\r\n\r\n", b"Transfer-Encoding: chunked\r\n",
    b"Content-Encoding: gzip\r\n", b"Content-Length: -1\r\n", b"Content-Length: 2147483647\r\n",
    b"Content-Type: text/html\r\n", b"--b\r\n", b"--b--\r\n", b"\r\n\r\n", b"\xff\xd8", b"\xff\xd9",
    b"\xff\xc0\x00\x11\x08\xff\xff\xff\xff", b"#EXTM3U\n", b"RIFF", b"ID3",
)  # fmt: skip
# Seconds, for reads that end as soon as the server hangs up; FFmpeg's own limit is 5 s.
LONGEST_S = 8.0


def jpeg(number: int, width: int = WIDTH, height: int = HEIGHT) -> bytes:
    noise = np.random.default_rng(number).integers(0, 255, (height, width, 3), dtype=np.uint8)
    return cv2.imencode(".jpg", noise)[1].tobytes()


def part(image: bytes, length: int | None = None) -> bytes:
    """Return an image as sent, with the length that it declares; its own by default."""
    declared = len(image) if length is None else length
    head = f"--b\r\nContent-Type: image/jpeg\r\nContent-Length: {declared}\r\n\r\n"
    return head.encode() + image + b"\r\n"


GOOD = [part(jpeg(number)) for number in range(PARTS)]
STREAM = HEAD + b"".join(GOOD)


class DamagedCamera(socketserver.ThreadingTCPServer):
    """A camera on its own port that answers any request; a context manager.

    Attributes:
        content: sent to each client before its connection is closed. None: good images at
            50 per second without an end.
        between: sent once between two of these.
    """

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Answer)
        self.content: bytes | None = None
        self.between: Iterator[bytes] = iter(())
        self.url = f"http://127.0.0.1:{self.server_address[1]}/video"

    def handle_error(self, request: object, client_address: object) -> None:
        """Ignore a client that disconnects."""


class Answer(socketserver.StreamRequestHandler):
    server: DamagedCamera

    def handle(self) -> None:
        while self.rfile.readline().strip():
            pass
        with contextlib.suppress(OSError):
            if self.server.content is not None:
                self.wfile.write(self.server.content)
                return
            self.wfile.write(HEAD)
            while True:
                for each in GOOD:
                    between, self.server.between = self.server.between, iter(())
                    for damage in between:
                        self.wfile.write(damage)
                    self.wfile.write(each)
                    time.sleep(0.02)


@pytest.fixture(scope="module")
def camera() -> Iterator[DamagedCamera]:
    with DamagedCamera() as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.02,))
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def played(url: str) -> int:
    """Read the stream to its end, check the images and return their number."""
    began, count = time.monotonic(), 0
    capture = NetworkCapture(url)
    while capture.grab():
        image = capture.retrieve()
        if image is not None:
            assert image.dtype == np.uint8
            assert image.ndim in (2, 3)
            count += 1
    assert time.monotonic() - began < LONGEST_S
    return count


def test_an_intact_stream_is_read(camera: DamagedCamera) -> None:
    camera.content = STREAM
    assert played(camera.url) >= PARTS - 2


@examples(40)
@given(content=damaged([STREAM, STREAM.replace(b"\r\nContent-Length", b"\r\nX")], PIECES, most=4)
       | hostile_bytes((HEAD, GOOD[0], *PIECES)))  # fmt: skip
@example(b"HTTP/1.0 302 Found\r\nLocation: /video\r\n\r\n")
@example(HEAD + b"--b\r\n" * 20_000)
@example(HEAD + b"--b\r\n" + b"x" * 2_000_000)
@example(b"HTTP/1.0 200 OK\r\n" + b"X: y\r\n" * 100_000)
@example(STREAM.replace(b"image/jpeg", b"text/html"))
def test_a_damaged_stream_is_refused_or_gives_images(camera: DamagedCamera, content: bytes) -> None:
    camera.content = content
    count = read_or_refused(lambda: played(camera.url), SourceError)
    assert count is None or count <= 4 * PARTS


@examples(60)
@given(damaged_text(["http://a:b@h:80/x?user=c&pwd=d,rtsp://h/y", "sbs:http://[::1]:1/"])
       | hostile_text(("http://", "rtsp://", "sbs:", ",", "@", ":", "[", "]", "?")))  # fmt: skip
@example("sbs:http://h/?pwd=a&b=\udcff")
def test_addresses_are_parsed_or_refused(text: str) -> None:
    spec = read_or_refused(lambda: parse_urls(text), SourceError)
    if spec is not None:
        assert 1 <= len(spec.targets) <= 2
        assert all(each.network for each in spec.targets)


def test_an_endless_part_is_reported_and_recovered_from(camera: DamagedCamera) -> None:
    camera.content = None
    source = CameraSource(parse_urls(f"sbs:{camera.url}"))
    try:
        watch = Watch(source)
        watch.read_frames(5)
        if sys.platform == "linux":
            import psutil

            (child,) = grabbers()
            assert child.rlimit(psutil.RLIMIT_DATA)[0] == _MOST_MEMORY_BYTES
        camera.between = endless()
        watch.read_until(lambda: watch.troubles)
        watch.read_frames(5)
        for _, trouble in watch.troubles:
            assert_one_sentence(trouble)
            assert camera.url in trouble
        assert {frame.left.shape for frame in watch.frames} == {(HEIGHT, WIDTH // 2, 3)}
    finally:
        source.close()
    assert grabbers() == []


@pytest.mark.parametrize("declares_all", [False, True])
def test_truncated_images_are_reported_and_not_used(
    camera: DamagedCamera, declares_all: bool
) -> None:
    camera.content = None
    whole = jpeg(99)
    truncated = part(whole[: len(whole) // 2], len(whole) if declares_all else None)
    source = CameraSource(parse_urls(f"sbs:{camera.url}"))
    try:
        watch = Watch(source)
        watch.read_frames(5)
        camera.between = repeated(truncated)
        watch.read_until(lambda: "cannot be decoded" in str(watch.troubles[-1:]))
        watch.read_frames(5)
    finally:
        source.close()
    expected = [cv2.imdecode(np.frombuffer(jpeg(n), np.uint8), 1) for n in range(PARTS)]
    for frame in watch.frames:
        assert frame.right is not None
        both = np.hstack([frame.left, frame.right])
        assert any(np.array_equal(both, each) for each in expected)


def test_images_of_another_size_are_reported_and_not_scaled(camera: DamagedCamera) -> None:
    camera.content = None
    source = CameraSource(parse_urls(f"sbs:{camera.url}"))
    try:
        watch = Watch(source)
        watch.read_frames(5)
        camera.between = repeated(part(jpeg(99, 2 * WIDTH, 2 * HEIGHT)))
        watch.read_until(lambda: "from 64x48 to 128x96 pixels" in str(watch.troubles[-1:]))
        assert {frame.left.shape for frame in watch.frames} == {(HEIGHT, WIDTH // 2, 3)}
    finally:
        source.close()


def repeated(sent: bytes) -> Iterator[bytes]:
    """Yield a part for 2 s at the camera's rate."""
    for _ in range(100):
        yield sent
        time.sleep(0.02)


def endless() -> Iterator[bytes]:
    """Yield a part that claims to exceed all memory, for as long as it is read."""
    yield b"--b\r\nContent-Type: image/jpeg\r\nContent-Length: 2000000000\r\n\r\n"
    end = time.monotonic() + 20.0
    while time.monotonic() < end:
        yield bytes(100_000)
