"""Reader of a recording's Foxglove messages, for exports: clouds, log, time stamps.

Field numbers are those of foxglove/PointCloud.proto, Log.proto and
google/protobuf/timestamp.proto.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.errors import SourceError
from observer.recording.images import message_fields

_STAMP = 1
_SECONDS, _NANOSECONDS = 1, 2
_CLOUD_STRIDE, _CLOUD_DATA = 4, 6
_LOG_LEVEL, _LOG_MESSAGE, _LOG_NAME = 2, 3, 4
# Layout as packed by ``observer.recording.foxglove.point_cloud``.
_POINT = np.dtype([("point", "<f4", 3), ("color", "u1", 4)])


@dataclass(frozen=True, eq=False)
class RecordedCloud:
    """Points (N, 3) float32, metres, camera frame, and colours (N, 3) uint8, RGB.

    Attributes:
        stamp_ns: stamp of its frame, nanoseconds since 1970.
    """

    stamp_ns: int
    points: NDArray[np.float32]
    colors: NDArray[np.uint8]


@dataclass(frozen=True)
class RecordedLog:
    """A sentence of the log.

    Attributes:
        level: 1 debug, 2 info, 3 warning, 4 error, 5 fatal. name: of the sender.
    """

    stamp_ns: int
    level: int
    name: str
    text: str


def read_cloud(message: memoryview) -> RecordedCloud:
    """Read a ``PointCloud``.

    Raises:
        SourceError: the message is damaged or of another layout.
    """
    fields = message_fields(message)
    data = fields.get(_CLOUD_DATA, memoryview(b""))
    if (
        fields.get(_CLOUD_STRIDE) != _POINT.itemsize
        or not isinstance(data, memoryview)
        or len(data) % _POINT.itemsize
    ):
        raise SourceError("a point cloud of the recording is damaged")
    packed = np.frombuffer(data, _POINT)
    return RecordedCloud(
        _stamp(fields.get(_STAMP)),
        np.ascontiguousarray(packed["point"]),
        np.ascontiguousarray(packed["color"][:, :3]),
    )


def read_log(message: memoryview) -> RecordedLog:
    """Read a ``Log``.

    Raises:
        SourceError: the message is damaged.
    """
    fields = message_fields(message)
    level = fields.get(_LOG_LEVEL, 0)
    return RecordedLog(
        _stamp(fields.get(_STAMP)),
        level if isinstance(level, int) else 0,
        _text(fields.get(_LOG_NAME)),
        _text(fields.get(_LOG_MESSAGE)),
    )


def read_stamp(message: memoryview) -> int:
    """Read the time at which the content of a message was received, nanoseconds since 1970.

    Raises:
        SourceError: the message is damaged.
    """
    return _stamp(message_fields(message).get(_STAMP))


def _stamp(value: int | memoryview | None) -> int:
    if not isinstance(value, memoryview):
        return 0
    parts = message_fields(value)
    seconds, nanoseconds = parts.get(_SECONDS, 0), parts.get(_NANOSECONDS, 0)
    if not isinstance(seconds, int) or not isinstance(nanoseconds, int):
        raise SourceError("a message of the recording is damaged")
    return seconds * 1_000_000_000 + nanoseconds


def _text(value: int | memoryview | None) -> str:
    return bytes(value).decode(errors="replace") if isinstance(value, memoryview) else ""
