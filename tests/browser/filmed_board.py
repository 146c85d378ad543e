"""Two network webcams filming a person with a chessboard: simulated images over real HTTP."""

from __future__ import annotations

import socketserver
import threading
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCalibration
from observer.simulation.imaging import StereoImager, undistorted_rays
from observer.simulation.scenarios import load_scenario
from observer.simulation.visibility import cast
from observer.simulation.world import World
from observer.vision.rectification import Rectification

_RATE_HZ = 12.0
# A camera never delivers the same image twice in a row: each gets other noise.
_NOISE = 1.5
_SHIFT_PX = 997
# Encoded once each: a busy machine could not encode new ones in time.
_NOISES = 8
_HEAD = b"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace;boundary=next\r\n\r\n"


@dataclass(frozen=True, eq=False)
class _Filmed:
    """Images of both cameras, each (480, 640, 3)."""

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]


class _Server(socketserver.ThreadingTCPServer):
    allow_reuse_address = True
    daemon_threads = False
    block_on_close = True

    def handle_error(self, request: object, client_address: object) -> None:
        """Ignore the error: a client that disconnects is normal here."""


class FilmedBoard:
    """Serves ``left`` and ``right`` as MJPEG; a context manager.

    The person holds the board in one pose until ``next_pose`` and finally puts it away; then the
    cameras see the lab, in which every distance is known.
    """

    def __init__(self) -> None:
        world = World(load_scenario("calibration"), 0)
        board = world.scenario.board
        assert board is not None
        period_s = board.hold_s + board.move_s
        imager = StereoImager(world)
        held = [k * period_s + board.hold_s / 2 for k in range(len(board.poses))]
        self._poses = [_Filmed(*imager.pair(k, time)) for k, time in enumerate(held)]
        self._lab = World(load_scenario("webcams"), 0)
        self._empty = _Filmed(*StereoImager(self._lab).pair(0, 0.0))
        self._now, self._pose, self._number = self._poses[0], 0, 0
        rng = np.random.default_rng(0)
        noise = _NOISE * rng.standard_normal(self._now.left.shape)
        self._noise = np.rint(noise).astype(np.int16)
        self._encoded: dict[tuple[int, int], bytes] = {}
        self._jpegs = {"left": b"", "right": b""}
        self._changed = threading.Condition()
        self._ends = threading.Event()
        film = self

        class Handler(socketserver.StreamRequestHandler):
            def handle(self) -> None:
                film._serve(self)

        self._server = _Server(("127.0.0.1", 0), Handler)
        self._threads = (
            threading.Thread(target=self._server.serve_forever, args=(0.02,)),
            threading.Thread(target=self._film),
        )

    def __enter__(self) -> FilmedBoard:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._server.shutdown()
        for thread in self._threads:
            thread.join()
        self._server.server_close()

    @property
    def spec(self) -> str:
        """Both cameras as a user types them."""
        port = self._server.server_address[1]
        return ",".join(f"http://127.0.0.1:{port}/{side}" for side in ("left", "right"))

    def next_pose(self) -> None:
        """Hold the board in the next pose; after the last comes the first."""
        self._pose = (self._pose + 1) % len(self._poses)
        self._now = self._poses[self._pose]

    def put_away(self) -> None:
        self._now = self._empty

    def distance_m(self, found: StereoCalibration, u: float, v: float) -> float:
        """Return the true distance of a place in the lab from the left lens, m, as for a tape.

        Args:
            found: the calibration under test. u, v: pixel of the left image rectified by it.
        """
        rectification = Rectification(found)
        camera = rectification.camera
        ray = np.array([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0])
        ray = ray @ rectification.R_rectified_left
        at = cv2.projectPoints(ray[None, None], np.zeros(3), np.zeros(3), found.K1, found.D1)[0]
        column, row = np.rint(at.ravel()).astype(int)
        true = self._lab.true_calibration
        rays = undistorted_rays(true.width, true.height, true.K1, true.D1)[row, column][None]
        seen = cast(self._lab, self._lab.T_room_left(0.0).inverse(), rays, 0.0)
        return float(np.hypot(1.0, np.linalg.norm(rays[0])) / seen.inverse_depth[0])

    def _film(self) -> None:
        while not self._ends.wait(1 / _RATE_HZ):
            now, number = self._now, self._number
            other = number + _NOISES // 2
            jpegs = {"left": self._jpeg(now.left, number), "right": self._jpeg(now.right, other)}
            with self._changed:
                self._jpegs, self._number = jpegs, number + 1
                self._changed.notify_all()
        with self._changed:
            self._changed.notify_all()

    def _jpeg(self, image: NDArray[np.uint8], number: int) -> bytes:
        key = id(image), number % _NOISES
        if key not in self._encoded:
            noise = np.roll(self._noise.reshape(-1), key[1] * _SHIFT_PX).reshape(image.shape)
            noisy = np.clip(image + noise, 0, 255).astype(np.uint8)
            quality = [cv2.IMWRITE_JPEG_QUALITY, 92]
            self._encoded[key] = cv2.imencode(".jpg", noisy, quality)[1].tobytes()
        return self._encoded[key]

    def _serve(self, handler: socketserver.StreamRequestHandler) -> None:
        side = handler.rfile.readline().split()[1].decode().strip("/")
        while handler.rfile.readline().strip():
            pass
        handler.wfile.write(_HEAD)
        while not self._ends.is_set():
            with self._changed:
                self._changed.wait()
                jpeg = self._jpegs[side]
            head = f"--next\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
            handler.wfile.write(head.encode() + jpeg + b"\r\n")
