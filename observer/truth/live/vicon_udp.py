"""Receiver of Vicon's UDP Object Stream: one thread owns the socket."""

from __future__ import annotations

import socket
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from observer.truth.live.heard import LiveCapture
from observer.truth.live.intake import Intake
from observer.truth.live.vicon_stream import ViconObject, ViconStreamError, unpack_frame

_LONGEST_DATAGRAM = 65_536
_BUFFER = 1 << 20
_LOOK_EVERY_S = 1.0
# Seconds: two senders would mix two clocks, so another is accepted only after this much silence.
_SILENT_S = 2.0


class ViconUdpCapture(LiveCapture):
    """Objects of Vicon Tracker. The frame number is the clock; its rate is found from arrivals.

    Args:
        port: the one Tracker sends to. spec: as opened. clock: host's monotonic clock.
    """

    def __init__(self, port: int, *, spec: str, clock: Callable[[], float]) -> None:
        self._port = port
        self._sender: tuple[str, int] | None = None
        self._heard = 0.0
        intake = Intake(clock, counts=True, millimetres=True)
        super().__init__(intake, spec=spec, name=f"vicon udp {port}", clock=clock)

    def _listened(self) -> str | None:
        try:
            self._listen()
        except OSError as error:
            why = error.strerror or str(error)
            return f"cannot listen on UDP port {self._port}: {why}"
        return None

    def _listen(self) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
            port.setblocking(False)
            port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
            # Tracker sends to one address or broadcasts, so bind to all.
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
            frame, objects = unpack_frame(data)
        except ViconStreamError:
            self._intake.malformed()
            return
        if sender != self._sender:
            if self._sender is not None and received - self._heard < _SILENT_S:
                self._intake.note(
                    "senders",
                    f"{sender[0]} also sends to this port and is ignored; {self._sender[0]} is "
                    "used",
                )
                return
            self._sender = sender
            self._intake.connected()
        self._heard = received
        for each in objects:
            self._pose(frame, each, received)

    def _pose(self, frame: int, body: ViconObject, received: float) -> None:
        numbers = (*body.translation_mm, *body.rotation_rad)
        finite = bool(np.isfinite(numbers).all())
        rotation = Rotation.from_euler("XYZ", body.rotation_rad).as_matrix() if finite else None
        position = np.array(body.translation_mm) / 1000
        self._intake.pose(body.name, float(frame), received, numbers, position, rotation)
