"""Vicon's UDP Object Stream from a port: one thread owns the socket."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from observer.truth.live.contract import LiveCaptureReport
from observer.truth.live.intake import Intake
from observer.truth.live.vicon_stream import ViconObject, ViconStreamError, unpack_frame
from observer.truth.live.wakeup import Wakeup
from observer.truth.motion_capture import BodySample

_RETRY_S = 1.0
_LONGEST_DATAGRAM = 65_536
_BUFFER = 1 << 20
_LOOK_EVERY_S = 1.0
# Two senders at once would be two clocks: another is heard once the first has been silent.
_SILENT_S = 2.0
_CLOSE_WITHIN_S = 2.0


class ViconUdpCapture:
    """Fulfils ``LiveCapture``. The frame's number is the clock: its rate is found from arrivals.

    Args:
        port: where Tracker sends to. spec: as it was opened. clock: host's monotonic clock.
    """

    def __init__(self, port: int, *, spec: str, clock: Callable[[], float]) -> None:
        self._port, self._spec, self._clock = port, spec, clock
        self._intake = Intake(clock, counts=True, millimetres=True)
        self._wakeup = Wakeup()
        self._sender: tuple[str, int] | None = None
        self._heard = 0.0
        self._thread = threading.Thread(target=self._run, name=f"vicon udp {port}", daemon=True)
        self._thread.start()

    @property
    def spec(self) -> str:
        return self._spec

    def drain(self) -> tuple[BodySample, ...]:
        return self._intake.drain()

    def report(self) -> LiveCaptureReport:
        return self._intake.report()

    def close(self) -> None:
        self._wakeup.end()
        self._thread.join(_CLOSE_WITHIN_S)

    # --- the thread ---------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            while not self._wakeup.ended:
                try:
                    self._listen()
                except OSError as error:
                    why = error.strerror or str(error)
                    self._intake.lost(f"UDP port {self._port} cannot be listened at: {why}")
                    self._wakeup.pause(_RETRY_S)
        finally:
            self._intake.lost(f"nobody listens at UDP port {self._port} any more")
            self._wakeup.close()

    def _listen(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
            port.setblocking(False)
            port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
            # Tracker sends to an address or to everybody in the network.
            port.bind(("", self._port))
            self._intake.waiting()
            while not self._wakeup.ended:
                if self._wakeup.wait(_LOOK_EVERY_S, port):
                    try:
                        data, sender = port.recvfrom(_LONGEST_DATAGRAM)
                    except BlockingIOError:
                        continue
                    self._take(data, sender, self._clock())

    def _take(self, data: bytes, sender: tuple[str, int], received: float) -> None:
        try:
            frame = unpack_frame(data)
        except ViconStreamError:
            self._intake.malformed()
            return
        if sender != self._sender:
            if self._sender is not None and received - self._heard < _SILENT_S:
                self._intake.note(
                    "senders",
                    f"{sender[0]} sends to this port as well as {self._sender[0]} and is left out",
                )
                return
            self._sender = sender
            self._intake.connected()
        self._heard = received
        for each in frame.objects:
            self._pose(frame.frame, each, received)

    def _pose(self, frame: int, body: ViconObject, received: float) -> None:
        numbers = (*body.translation_mm, *body.rotation_rad)
        finite = bool(np.isfinite(numbers).all())
        rotation = Rotation.from_euler("XYZ", body.rotation_rad).as_matrix() if finite else None
        position = np.array(body.translation_mm) / 1000
        self._intake.pose(body.name, float(frame), received, numbers, position, rotation)
