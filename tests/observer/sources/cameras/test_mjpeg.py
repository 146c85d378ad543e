"""MJPEG over HTTP: parts in pieces, and cameras that queue, truncate or resize their images."""

from __future__ import annotations

import base64
import contextlib
import socketserver
import threading
import time
from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.sources.cameras.capture import NetworkCapture, open_capture
from observer.sources.cameras.mjpeg import MjpegCapture, Parts, is_whole, open_mjpeg
from observer.sources.cameras.settings import CameraSettings
from observer.sources.cameras.source import CameraSource
from observer.sources.cameras.spec import parse_urls

from ....damage import damaged, examples
from .watching import Watch

RATE_HZ = 25.0


def jpeg(number: int, width: int = 64, height: int = 48) -> bytes:
    noise = np.random.default_rng(number).integers(0, 255, (height, width, 3), dtype=np.uint8)
    return cv2.imencode(".jpg", noise)[1].tobytes()


def part(body: bytes, *headers: str, sized: bool = True) -> bytes:
    lines = ["--b", "Content-Type: image/jpeg", *headers]
    lines += [f"Content-Length: {len(body)}"] if sized else []
    return "\r\n".join(lines).encode() + b"\r\n\r\n" + body + b"\r\n"


GOOD = [jpeg(number) for number in range(10)]


class MjpegCamera(socketserver.ThreadingTCPServer):
    """A camera on its own port; a context manager.

    Attributes:
        head: of its answer. truncates: whether it sends the first half of each image only.
        size: of its images. behind_s: how long ago each image was taken. stamped: whether each
            part tells when its image was taken.
        password: asked for, as in ``user:password``.
    """

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Answer)
        self.head = b"Content-Type: multipart/x-mixed-replace; boundary=--b\r\n"
        self.truncates = self.stamped = False
        self.size = (64, 48)
        self.behind_s = 0.0
        self.password: str | None = None
        self.url = f"http://127.0.0.1:{self.server_address[1]}/video"

    def handle_error(self, request: object, client_address: object) -> None:
        """Ignore a client that disconnects."""

    def image(self, number: int) -> bytes:
        image = GOOD[number % len(GOOD)] if self.size == (64, 48) else jpeg(number, *self.size)
        return image[: len(image) // 2] if self.truncates else image


class _Answer(socketserver.StreamRequestHandler):
    server: MjpegCamera

    def handle(self) -> None:
        camera, lines = self.server, []
        while line := self.rfile.readline().strip():
            lines.append(line)
        with contextlib.suppress(OSError):
            if camera.password is not None:
                wanted = b"Authorization: Basic " + base64.b64encode(camera.password.encode())
                if wanted not in lines:
                    self.wfile.write(
                        b'HTTP/1.1 401 No\r\nWWW-Authenticate: Basic realm="x"\r\n'
                        b"Content-Length: 0\r\nConnection: close\r\n\r\n"
                    )
                    return
            self.wfile.write(b"HTTP/1.1 200 OK\r\n" + camera.head + b"\r\n")
            began, number = time.monotonic(), 0
            while True:
                headers = []
                if camera.stamped:
                    headers.append(f"X-Timestamp: {time.time() - camera.behind_s:.6f}")
                self.wfile.write(part(camera.image(number), *headers))
                number += 1
                time.sleep(max(0.0, began + number / RATE_HZ - time.monotonic()))


@pytest.fixture
def camera() -> Iterator[MjpegCamera]:
    with MjpegCamera() as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.02,))
        thread.start()
        yield server
        server.shutdown()
        thread.join()


@examples(100)
@given(
    bodies=st.lists(st.sampled_from(GOOD) | st.binary(max_size=40), min_size=1, max_size=5),
    sized=st.booleans(),
    pieces=st.lists(st.integers(1, 3000), max_size=20),
)
def test_parts_are_found_however_the_stream_is_split(
    bodies: list[bytes], sized: bool, pieces: list[int]
) -> None:
    if not sized:
        bodies = [body for body in bodies if is_whole(body)]
    stream = b"rest\r\n" + b"".join(
        part(body, f"x-timestamp: {n}.5", sized=sized) for n, body in enumerate(bodies)
    )
    parts, found, place = Parts("b"), [], 0
    for length in (*pieces, len(stream)):
        parts.feed(stream[place : place + length])
        place += length
        while (each := parts.next()) is not None:
            found.append(each)
    assert [each.sent for each in found] == [n + 0.5 for n in range(len(bodies))]
    if sized:
        assert [each.data for each in found] == bodies
    else:
        assert [each.data.rstrip(b"\r\n") for each in found] == bodies


@examples(100)
@given(damaged([b"".join(part(body, "X-Timestamp: 1") for body in GOOD[:3])]), st.integers(1, 4000))
def test_a_damaged_stream_gives_parts_or_none(stream: bytes, piece: int) -> None:
    parts, count = Parts("b"), 0
    for place in range(0, len(stream), piece):
        parts.feed(stream[place : place + piece])
        while (each := parts.next()) is not None:
            count += 1
            assert each.sent is None or each.sent >= 0.0
    assert count <= stream.count(b"--b")


def test_a_part_without_an_end_is_refused() -> None:
    parts = Parts("b")
    parts.feed(part(b"", "Content-Length: 2000000000", sized=False))
    for _ in range(60):
        parts.feed(bytes(1_000_000))
        assert parts.next() is None
    with pytest.raises(ValueError, match="without an end"):
        parts.feed(bytes(10_000_000))


def test_only_a_whole_image_is_one() -> None:
    image = GOOD[0]
    assert is_whole(image)
    assert is_whole(image + b"\0\0\r\n")
    thumbnail = b"\xff\xd8\xff\xe1" + image + image[2:]
    assert is_whole(thumbnail)
    assert not is_whole(thumbnail[: -len(image) // 2])
    for useless in (b"", image[:-2], image[: len(image) // 2], image[2:], b"\xff\xd8\xff\xd9"):
        assert not is_whole(useless)


def test_images_that_queued_up_give_way_to_the_newest(camera: MjpegCamera) -> None:
    camera.stamped = True
    capture = open_mjpeg(camera.url)
    assert capture is not None
    assert capture.grab()
    before = capture.sent()
    time.sleep(0.5)
    assert capture.grab()
    after = capture.sent()
    assert before is not None
    assert after is not None
    assert after - before > 0.3
    image = capture.retrieve()
    assert image is not None
    assert image.shape == (48, 64, 3)
    assert capture.settle().accepted == {
        "size": "64x48", "codec": "MJPG", "timestamps": "of the stream",
    }  # fmt: skip


def test_a_truncated_image_is_none(camera: MjpegCamera) -> None:
    camera.truncates = True
    capture = open_mjpeg(camera.url)
    assert capture is not None
    assert capture.grab()
    assert capture.retrieve() is None
    assert capture.settle().accepted == {"codec": "MJPG", "timestamps": "none"}


@pytest.mark.patient
def test_truncated_images_and_other_sizes_are_reported_and_not_passed_on(
    camera: MjpegCamera,
) -> None:
    source = CameraSource(parse_urls(f"sbs:{camera.url}"))
    try:
        watch = Watch(source)
        watch.read_frames(5)
        camera.truncates = True
        watch.read_until(lambda: "that cannot be decoded" in str(watch.troubles[-1:]))
        camera.truncates = False
        watch.read_frames(5)
        camera.size = (128, 96)
        watch.read_until(lambda: "from 64x48 to 128x96 pixels" in str(watch.troubles[-1:]))
        assert {frame.left.shape for frame in watch.frames} == {(48, 32, 3)}
    finally:
        source.close()


@pytest.mark.patient
def test_a_queue_that_grows_slowly_is_noticed_by_the_timestamps_of_the_parts(
    camera: MjpegCamera,
) -> None:
    camera.stamped = True
    source = CameraSource(parse_urls(f"sbs:{camera.url}"))
    try:
        watch = Watch(source)
        watch.read_frames(20)
        for _ in range(30):
            camera.behind_s += 0.02
            watch.read_for(0.04)
        watch.read_until(lambda: "falls behind" in str(watch.troubles[-1:]))
    finally:
        source.close()


def test_user_and_password_are_sent_when_asked_for(camera: MjpegCamera) -> None:
    camera.password = "someone:p@ss w"
    with_password = camera.url.replace("http://", "http://someone:p%40ss%20w@")
    capture = open_mjpeg(with_password)
    assert capture is not None
    assert capture.grab()
    assert open_mjpeg(camera.url) is None
    assert open_mjpeg(with_password.replace("w@", "v@")) is None


def test_other_kinds_of_video_are_left_to_ffmpeg(camera: MjpegCamera) -> None:
    assert isinstance(open_capture(camera.url, CameraSettings()), MjpegCapture)
    camera.head = b"Content-Type: multipart/x-mixed-replace\r\n"
    assert open_mjpeg(camera.url) is None
    camera.head = b"Content-Type: image/jpeg\r\n"
    assert isinstance(open_capture(camera.url, CameraSettings()), NetworkCapture)
    assert open_mjpeg("rtsp://127.0.0.1/") is None
