"""MJPEG streams over HTTP: parts with their headers, the newest image, and whether it is whole.

FFmpeg reads such streams as well, but it drops the headers of the parts, which may tell when an
image was sent, fills the missing rows of a truncated image and scales images of another size.
"""

from __future__ import annotations

import contextlib
import http.client
import math
import re
import select
import ssl
import urllib.request
from dataclasses import dataclass
from urllib.parse import unquote, urlsplit, urlunsplit

import cv2
import numpy as np

from observer.sources.cameras.settings import AppliedSettings
from observer.types import Image

# Of each wait for data.
_TIMEOUT_S = 3.0
_CHUNK = 1 << 16
_LONGEST_HEAD = 1 << 13
_LONGEST_PART = 1 << 26
# After so many a frame is returned though more have come: a server may send them without a pause.
_MOST_AT_ONCE = 64
_LENGTH = re.compile(
    rb"^content-length:[ \t]*([0-9]{1,12})[ \t]*\r?$", re.IGNORECASE | re.MULTILINE
)
_STAMP = re.compile(rb"^x-timestamp:[ \t]*([0-9.]{1,32})[ \t]*\r?$", re.IGNORECASE | re.MULTILINE)
_HEAD_END = re.compile(rb"\r?\n\r?\n")
_START_OF_SCAN, _END_OF_IMAGE = b"\xff\xda", b"\xff\xd9"


@dataclass(frozen=True)
class Part:
    """One part of a multipart stream.

    Attributes:
        data: its body. sent: its X-Timestamp, seconds on the camera's clock; None without one.
    """

    data: bytes
    sent: float | None


class Parts:
    """Parts of a multipart stream from its bytes, in pieces of any size.

    Args:
        boundary: as declared in the stream's content type.
    """

    def __init__(self, boundary: str) -> None:
        # Cameras declare it with or without the dashes that precede it in the stream.
        self._boundary = b"--" + boundary.encode("latin-1", "replace").lstrip(b"-")
        self._data = bytearray()
        self._searched = 0
        # Where the body begins once its head was read.
        self._body: int | None = None
        self._length: int | None = None
        self._sent: float | None = None

    def feed(self, data: bytes) -> None:
        """Take the next bytes.

        Raises:
            ValueError: a part is longer than any image.
        """
        self._data += data
        if len(self._data) > _LONGEST_PART:
            raise ValueError("a part without an end")

    def next(self) -> Part | None:
        """Return the next part; None until more bytes come."""
        if self._body is None and not self._read_head():
            return None
        assert self._body is not None
        end = self._end(self._body)
        if end is None:
            return None
        part = Part(bytes(self._data[self._body : end]), self._sent)
        self._forget(end)
        return part

    def _read_head(self) -> bool:
        found = self._find_boundary(0)
        if found is None:
            # What comes before a boundary is of no use.
            self._forget(max(0, len(self._data) - len(self._boundary)))
            return False
        head = found + len(self._boundary)
        end = _HEAD_END.search(self._data, head, head + _LONGEST_HEAD)
        if end is None:
            if len(self._data) - head > _LONGEST_HEAD:
                self._forget(head)
            return False
        text = bytes(self._data[head : end.end()])
        length, sent = _LENGTH.search(text), _STAMP.search(text)
        self._length = None if length is None else int(length[1])
        self._sent = None if sent is None else _seconds(sent[1])
        self._body = self._searched = end.end()
        return True

    def _end(self, body: int) -> int | None:
        """Return where the body ends; None where its end has not come yet."""
        if self._length is not None:
            end = body + self._length
            return end if end <= len(self._data) else None
        found = self._find_boundary(body)
        if found is None and is_whole(self._data[body:]):
            # Without waiting for the next boundary, which comes with the next image.
            return len(self._data)
        return found

    def _find_boundary(self, start: int) -> int | None:
        found = self._data.find(self._boundary, max(start, self._searched))
        if found >= 0:
            return found
        self._searched = max(start, len(self._data) - len(self._boundary) + 1)
        return None

    def _forget(self, count: int) -> None:
        del self._data[:count]
        self._searched, self._body, self._length, self._sent = 0, None, None, None


class MjpegCapture:
    """An MJPEG stream over HTTP; implements ``Capture``. Its frames are stamped at arrival.

    Images that have queued up here are skipped for the newest.

    Args:
        response: to a GET, its body unread. boundary: of its content type.
    """

    rate: float | None = None

    def __init__(self, response: http.client.HTTPResponse, boundary: str) -> None:
        self._response = response
        self._parts = Parts(boundary)
        self._part = Part(b"", None)
        self._ended = False

    def grab(self) -> bool:
        for count in range(_MOST_AT_ONCE):
            part = self._parts.next()
            while part is None and not self._ended and (not count or self._is_readable()):
                self._read()
                part = self._parts.next()
            if part is None:
                return count > 0
            self._part = part
        return True

    def stamp(self) -> float | None:
        return None

    def sent(self) -> float | None:
        return self._part.sent

    def settle(self) -> AppliedSettings:
        stamped = self._part.sent is not None
        accepted = {"codec": "MJPG", "timestamps": "of the stream" if stamped else "none"}
        image = self.retrieve()
        if image is not None:
            accepted = {"size": f"{image.shape[1]}x{image.shape[0]}", **accepted}
        return AppliedSettings(accepted)

    def retrieve(self) -> Image | None:
        data = self._part.data
        # A decoder fills what a truncated image lacks, and says nothing.
        if not is_whole(data):
            return None
        try:
            image = cv2.imdecode(
                np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
            )
        except cv2.error:
            return None
        return None if image is None or not image.size else np.asarray(image, np.uint8)

    def _is_readable(self) -> bool:
        return bool(select.select([self._response], [], [], 0.0)[0])

    def _read(self) -> None:
        try:
            data = self._response.read1(_CHUNK)
            self._parts.feed(data)
        except (OSError, ValueError, http.client.HTTPException):
            data = b""
        self._ended = not data


def open_mjpeg(url: str) -> MjpegCapture | None:
    """Open an MJPEG stream; None if the URL cannot be read or is another kind of video."""
    if not url.lower().startswith(("http://", "https://")):
        return None
    try:
        response = _get(url)
    except (OSError, ValueError, http.client.HTTPException):
        return None
    if not isinstance(response, http.client.HTTPResponse):
        return None
    boundary = response.headers.get_param("boundary")
    kind = response.headers.get_content_type()
    if kind != "multipart/x-mixed-replace" or not isinstance(boundary, str) or not boundary:
        with contextlib.suppress(OSError):
            response.close()
        return None
    return MjpegCapture(response, boundary)


def is_whole(data: bytes | bytearray) -> bool:
    """Return whether the data begin as a JPEG image and hold the end of its last scan."""
    # Within a scan, these markers cannot occur; a thumbnail before it has its own.
    scan = data.rfind(_START_OF_SCAN)
    return data.startswith(b"\xff\xd8") and 0 <= scan < data.rfind(_END_OF_IMAGE)


def _seconds(text: bytes) -> float | None:
    try:
        seconds = float(text)
    except ValueError:
        return None
    return seconds if math.isfinite(seconds) else None


def _get(url: str) -> object:
    parts = urlsplit(url)
    target = urlunsplit(parts._replace(netloc=parts.netloc.rpartition("@")[2], fragment=""))
    passwords = urllib.request.HTTPPasswordMgrWithDefaultRealm()
    if parts.username is not None:
        passwords.add_password(None, target, unquote(parts.username), unquote(parts.password or ""))
    # Certificates of cameras are their own, so FFmpeg does not check them either.
    context = ssl.create_default_context()
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    opener = urllib.request.OpenerDirector()
    # None for proxies: a camera is in the network of the robot.
    for handler in (
        urllib.request.HTTPHandler(),
        urllib.request.HTTPSHandler(context=context),
        urllib.request.HTTPRedirectHandler(),
        urllib.request.HTTPErrorProcessor(),
        urllib.request.HTTPDefaultErrorHandler(),
        urllib.request.HTTPBasicAuthHandler(passwords),
        urllib.request.HTTPDigestAuthHandler(passwords),
    ):
        opener.add_handler(handler)
    return opener.open(urllib.request.Request(target), timeout=_TIMEOUT_S)
