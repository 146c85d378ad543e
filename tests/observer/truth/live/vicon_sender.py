"""A sender of Vicon's UDP Object Stream."""

from __future__ import annotations

import socket
import struct
from collections.abc import Sequence

from scipy.spatial.transform import Rotation

from observer.truth.live.vicon_stream import ViconObject

from .mishaps import Sent


def pack_frame(frame: int, objects: Sequence[ViconObject], filling: int = 0) -> bytes:
    """Return a datagram, zero-padded to ``filling`` bytes like Vicon's fixed-size buffers."""
    data = struct.pack("<IB", frame % 2**32, len(objects))
    for each in objects:
        data += struct.pack("<BH", 0, 72)
        data += struct.pack("<24s6d", each.name.encode(), *each.translation_mm, *each.rotation_rad)
    return data.ljust(filling, b"\0")


class ViconSender:
    """Sends to a port of this host.

    Attributes:
        frames_behind: added to each frame's number.
    """

    def __init__(self, port: int, *, host: str = "127.0.0.1", filling: int = 512) -> None:
        self._to, self._filling = (host, port), filling
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.frames_behind = 0

    def send(self, poses: list[Sent]) -> None:
        """Send one instant's poses in one datagram."""
        objects = []
        for each in poses:
            x, y, z, *quaternion = each.numbers
            angles = (
                Rotation.from_quat(quaternion).as_euler("XYZ") if any(quaternion) else [0.0] * 3
            )
            rx, ry, rz = (float(angle) for angle in angles)
            objects.append(ViconObject(each.name, (1000 * x, 1000 * y, 1000 * z), (rx, ry, rz)))
        self.raw(pack_frame(poses[0].frame + self.frames_behind, objects, self._filling))

    def raw(self, data: bytes) -> None:
        self._socket.sendto(data, self._to)

    def stop(self) -> None:
        self._socket.close()
