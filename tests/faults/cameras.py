"""Two network cameras in a still room, which fail as cameras do, at a known time."""

from __future__ import annotations

import contextlib
import socketserver
import threading
import time
from collections import deque
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from observer.camera import StereoCalibration
from observer.simulation.imaging import StereoImager
from observer.simulation.scenarios import load_scenario
from observer.simulation.world import World
from observer.types import Image

RATE_HZ = 20.0
# Each with its own noise, to distinguish a frozen camera from a still room.
_PICTURES = 12
_QUALITY = 92
_REMEMBERED = 400
_HEAD = b"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=frame\r\n\r\n"


def still_world() -> World:
    """Return the simulated lab with the observer parked and nothing else moving."""
    lab = load_scenario("lab")
    parked = lab.observer.model_copy(update={"motion": None})
    return World(lab.model_copy(update={"robots": (), "observer": parked}))


@dataclass
class Misbehaviour:
    """How a camera misbehaves; may be changed at any time from any thread.

    Attributes:
        unplugged: its streams end and connecting fails. hangs: its streams stay open but silent.
        frozen: it repeats its last picture. every: it sends only every n-th picture.
        image: JPEG that it sends instead; None: what it sees.
    """

    unplugged: bool = False
    hangs: bool = False
    frozen: bool = False
    every: int = 1
    image: bytes | None = None


class _Server(socketserver.ThreadingTCPServer):
    allow_reuse_address = True
    daemon_threads = True

    def handle_error(self, request: object, client_address: object) -> None:
        """Ignore the error: a client that disconnects is normal here."""


@dataclass
class Camera:
    """An MJPEG camera on its own port; a context manager.

    Attributes:
        pictures: JPEG, played over and over at ``RATE_HZ``.
        does: how it misbehaves.
    """

    pictures: list[bytes]
    does: Misbehaviour = field(default_factory=Misbehaviour)

    def __post_init__(self) -> None:
        camera = self

        class Handler(socketserver.StreamRequestHandler):
            def handle(self) -> None:
                with contextlib.suppress(OSError):
                    camera._serve(self)

        self._ends = False
        # When good pictures were sent.
        self._good: deque[float] = deque([0.0], maxlen=_REMEMBERED)
        self._server = _Server(("127.0.0.1", 0), Handler)
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.02,))

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self._server.server_address[1]}/video"

    @property
    def good_at(self) -> float:
        """Monotonic time at which the last good picture was sent."""
        return self._good[-1]

    def good_before(self, time: float) -> float:
        """Return when the last good picture up to ``time`` was sent, within the last seconds."""
        return max(each for each in tuple(self._good) if each <= time)

    def __enter__(self) -> Camera:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends = True
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()

    def behave(self) -> None:
        """Stop misbehaving."""
        self.does = Misbehaviour()

    def _serve(self, handler: socketserver.StreamRequestHandler) -> None:
        while handler.rfile.readline().strip():
            pass
        if self.does.unplugged:
            return
        handler.wfile.write(_HEAD)
        # Both cameras count from the same instant, so that they expose together.
        number = int(time.monotonic() * RATE_HZ) + 1
        shown = b""
        while not self._ends:
            time.sleep(max(0.0, number / RATE_HZ - time.monotonic()))
            does = replace(self.does)
            if does.unplugged:
                return
            if not does.hangs and number % does.every == 0:
                if not (does.frozen and shown):
                    shown = self.pictures[number % len(self.pictures)]
                self._send(handler, does.image or shown)
                if not does.frozen and does.image is None:
                    self._good.append(time.monotonic())
            number += 1

    def _send(self, handler: socketserver.StreamRequestHandler, picture: bytes) -> None:
        head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture)}\r\n\r\n"
        handler.wfile.write(head.encode() + picture + b"\r\n")


def stereo_cameras(world: World) -> tuple[Camera, Camera, StereoCalibration]:
    """Return left and right camera and their true calibration; nothing runs yet."""
    imager = StereoImager(world)
    pairs = [imager.pair(number, 0.0) for number in range(_PICTURES)]
    left, right = (Camera([jpeg(pair[side]) for pair in pairs]) for side in (0, 1))
    return left, right, world.true_calibration


def jpeg(image: Image) -> bytes:
    """Compress an image as a camera does."""
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()


def plain_picture(world: World, level: int) -> bytes:
    """Return what a covered (0) or a blinded (255) lens shows, with sensor noise."""
    camera = world.scenario.camera
    noise = np.random.default_rng(level).integers(-2, 3, (camera.height, camera.width, 3))
    return jpeg(np.clip(level + noise, 0, 255).astype(np.uint8))
