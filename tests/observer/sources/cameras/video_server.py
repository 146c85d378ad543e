"""Video servers on loopback with streams from ffmpeg: HTTP (MJPEG, MPEG-TS) and RTSP."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import socket
import socketserver
import subprocess
import tempfile
import threading
import time
from pathlib import Path

import pytest

_SLOWEST_START_S = 10.0


def need_ffmpeg() -> str:
    """Return the path of ffmpeg; without it, skip the test, or fail it in CI."""
    path = shutil.which("ffmpeg")
    if path is None:
        missing = "no ffmpeg on this machine: make system"
        if os.environ.get("CI"):
            pytest.fail(missing)
        pytest.skip(missing)
    return path


def ffmpeg_command(size: str, rate: float, *output: str) -> list[str]:
    """Return the command for a moving test image with camera noise, in real time."""
    picture = f"testsrc2=size={size}:rate={rate:g},noise=alls=20:allf=t"
    return [
        *(need_ffmpeg(), "-hide_banner", "-loglevel", "error", "-nostdin", "-re"),
        *("-f", "lavfi", "-i", picture, "-threads", "1", *output),
    ]


class _Server(socketserver.ThreadingTCPServer):
    allow_reuse_address = True
    daemon_threads = False
    block_on_close = True

    def handle_error(self, request: object, client_address: object) -> None:
        """Ignore a client that disconnects."""


class VideoServer:
    """Serves a stream to any number of clients, each with its own ffmpeg; a context manager.

    Args:
        size: as in ``320x240``. rate: frames per second.
        kind: ``mjpeg`` or ``h264`` (MPEG-TS) over HTTP, or ``rtsp`` (H.264, TCP only).
    """

    def __init__(self, size: str = "320x240", rate: float = 30.0, kind: str = "mjpeg") -> None:
        self._size = size
        self._rate = rate
        self._kind = kind
        self._encoders: list[subprocess.Popen[bytes]] = []
        video = self

        class Handler(socketserver.StreamRequestHandler):
            def handle(self) -> None:
                (video._serve_rtsp if kind == "rtsp" else video._serve_http)(self)

        self._server = _Server(("127.0.0.1", 0), Handler)
        self.port: int = self._server.server_address[1]
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.02,))

    def __enter__(self) -> VideoServer:
        need_ffmpeg()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self.stop()
        self._thread.join()
        self._server.server_close()

    @property
    def url(self) -> str:
        return url_of(self.port, self._kind)

    def stop(self) -> None:
        """End all streams, like a camera that is switched off."""
        for encoder in self._encoders:
            encoder.kill()

    def resize(self, size: str) -> None:
        """Continue with images of another size, in the same streams."""
        self._size = size
        self.stop()

    def _output(self) -> list[str]:
        if self._kind == "mjpeg":
            return ["-c:v", "mjpeg", "-q:v", "5", "-f", "mpjpeg"]
        h264 = ["-c:v", "libx264", "-preset", "ultrafast", "-tune", "zerolatency", "-g", "10"]
        return [*h264, "-pix_fmt", "yuv420p", "-f", "rtp" if self._kind == "rtsp" else "mpegts"]

    def _encode(self, *output: str, stdout: int | None = None) -> subprocess.Popen[bytes]:
        command = ffmpeg_command(self._size, self._rate, *self._output(), *output)
        encoder = subprocess.Popen(command, stdout=stdout, stderr=subprocess.DEVNULL)
        self._encoders.append(encoder)
        return encoder

    def _serve_http(self, handler: socketserver.StreamRequestHandler) -> None:
        while handler.rfile.readline().strip():
            pass
        content = (
            "multipart/x-mixed-replace;boundary=ffmpeg" if self._kind == "mjpeg" else "video/mp2t"
        )
        handler.wfile.write(f"HTTP/1.0 200 OK\r\nContent-Type: {content}\r\n\r\n".encode())
        handler.wfile.flush()
        size = None
        while size != self._size:
            size = self._size
            with self._encode("pipe:1", stdout=handler.connection.fileno()) as encoder:
                # ffmpeg exits by itself when nobody reads its output.
                encoder.wait()

    def _serve_rtsp(self, handler: socketserver.StreamRequestHandler) -> None:
        """Serve the least of RFC 2326 that a player over TCP needs; forward ffmpeg's packets."""
        with (
            tempfile.TemporaryDirectory() as folder,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as packets,
        ):
            packets.bind(("127.0.0.1", 0))
            packets.settimeout(0.2)
            file = Path(folder) / "stream.sdp"
            port = packets.getsockname()[1]
            target = f"rtp://127.0.0.1:{port}?pkt_size=1200"
            with self._encode("-sdp_file", str(file), target) as encoder:
                with contextlib.suppress(OSError):
                    if _negotiate(handler, file):
                        _relay(handler, packets, encoder)
                encoder.kill()


def url_of(port: int, kind: str = "mjpeg") -> str:
    """Return the address of such a stream at a port, which may be a proxy's."""
    return f"{'rtsp' if kind == 'rtsp' else 'http'}://127.0.0.1:{port}/video"


def _negotiate(handler: socketserver.StreamRequestHandler, sdp: Path) -> bool:
    """Answer until PLAY; return False if the client leaves before."""
    while line := handler.rfile.readline():
        method, address, _ = line.decode().split()
        headers = {}
        while header := handler.rfile.readline().strip():
            name, _, value = header.decode().partition(":")
            headers[name.lower()] = value.strip()
        extra, body = "Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN\r\n", b""
        if method == "DESCRIBE":
            body = _description(sdp)
            extra = (
                f"Content-Base: {address}/\r\nContent-Type: application/sdp\r\n"
                f"Content-Length: {len(body)}\r\n"
            )
        elif method == "SETUP":
            extra = "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\nSession: 1\r\n"
        elif method == "PLAY":
            extra = "Session: 1\r\n"
        head = f"RTSP/1.0 200 OK\r\nCSeq: {headers.get('cseq', '0')}\r\n{extra}\r\n"
        handler.wfile.write(head.encode() + body)
        if method == "PLAY":
            return True
    return False


def _description(sdp: Path) -> bytes:
    deadline = time.monotonic() + _SLOWEST_START_S
    while not (sdp.exists() and b"a=fmtp" in sdp.read_bytes()) and time.monotonic() < deadline:
        time.sleep(0.01)
    text = sdp.read_text()
    text = text[text.index("v=0") :].replace("\r\n", "\n")
    text = re.sub(r"m=video \d+", "m=video 0", text)
    return (text.strip() + "\na=control:track1\n").replace("\n", "\r\n").encode()


def _relay(
    handler: socketserver.StreamRequestHandler,
    packets: socket.socket,
    encoder: subprocess.Popen[bytes],
) -> None:
    while encoder.poll() is None:
        try:
            packet = packets.recv(65536)
        except TimeoutError:
            continue
        handler.wfile.write(b"$\0" + len(packet).to_bytes(2, "big") + packet)
