"""Refusals of a server, or of whatever answers in its place, become one sentence."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from app.client.server_api import DrivingFailed, ServerApi


class _Refusing(BaseHTTPRequestHandler):
    content = b""

    def do_GET(self) -> None:
        self.send_response(503)
        self.send_header("Content-Length", str(len(self.content)))
        self.end_headers()
        self.wfile.write(self.content)

    def log_message(self, format: str, *args: object) -> None:
        del format, args


@pytest.fixture
def api() -> Iterator[ServerApi]:
    server = HTTPServer(("127.0.0.1", 0), _Refusing)
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    made = ServerApi(f"http://127.0.0.1:{server.server_port}", "a token")
    yield made
    made.close()
    server.shutdown()
    thread.join()
    server.server_close()


_OTHERWISE = "GET /api/status was answered with status 503"


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b'{"detail": "the engine is starting"}', "the engine is starting"),
        (
            b'{"detail": [{"msg": "one"}, {"msg": 2}, 3, {"msg": "four"}]}',
            _OTHERWISE + ": one; four",
        ),
        (b'{"detail": [{"loc": []}]}', _OTHERWISE),
        (b'{"detail": null}', _OTHERWISE),
        (b'{"detail": 7}', _OTHERWISE),
        (b'{"detail": {"msg": "one"}}', _OTHERWISE),
        (b"[]", _OTHERWISE),
        (b"<html>", _OTHERWISE),
        (b"", _OTHERWISE),
    ],
)
def test_a_refusal_is_one_sentence(
    api: ServerApi, monkeypatch: pytest.MonkeyPatch, content: bytes, sentence: str
) -> None:
    monkeypatch.setattr(_Refusing, "content", content)
    with pytest.raises(DrivingFailed) as refused:
        api.get("status")
    assert str(refused.value) == sentence
