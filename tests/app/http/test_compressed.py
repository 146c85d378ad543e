"""Text and JSON are compressed for clients that accept it; text is revalidated in either form."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import pytest

from app.http import server as http_server

LONG = "export const words = 'said again and again';\n" * 200


@pytest.fixture
def panel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that stands in for the panel's."""
    folder = tmp_path / "static"
    folder.mkdir()
    (folder / "index.html").write_text(f"<!doctype html><title>Panel</title><!-- {LONG} -->")
    (folder / "long.js").write_text(LONG)
    (folder / "short.js").write_text("export {};")
    (folder / "picture.png").write_bytes(bytes(5000))
    monkeypatch.setattr(http_server, "static_folder", lambda: folder)
    return folder


async def sent(client: Any, path: str, **headers: str) -> tuple[Any, bytes]:
    """Return an answer, and the bytes of its body as received."""
    async with client.stream("GET", path, headers=headers) as answer:
        return answer, b"".join([chunk async for chunk in answer.aiter_raw()])


@pytest.mark.usefixtures("panel")
async def test_text_is_compressed_for_clients_that_accept_it(serve: Any) -> None:
    async with serve() as served:
        for path in ("/static/long.js", "/"):
            plain, whole = await sent(served.http, path, **{"accept-encoding": "identity"})
            assert "content-encoding" not in plain.headers
            answer, body = await sent(served.http, path, **{"accept-encoding": "br, gzip;q=0.8"})
            assert answer.headers["content-encoding"] == "gzip"
            assert int(answer.headers["content-length"]) == len(body) < len(whole) / 10
            assert gzip.decompress(body) == whole
            for each in (plain, answer):
                assert each.headers["vary"] == "Accept-Encoding"
                assert each.headers["cache-control"] == "no-cache"
        _, refused = await sent(served.http, "/static/long.js", **{"accept-encoding": "gzip;q=0"})
        assert refused == LONG.encode()


async def test_incompressible_content_is_sent_unchanged(panel: Path, serve: Any) -> None:
    async with serve() as served:
        for name in ("short.js", "picture.png"):
            answer, body = await sent(served.http, f"/static/{name}")
            assert "content-encoding" not in answer.headers
            assert body == (panel / name).read_bytes()
        part, body = await sent(served.http, "/static/long.js", range="bytes=0-9")
        assert (part.status_code, body) == (206, LONG[:10].encode())
        head = await served.http.head("/static/long.js")
        assert (head.status_code, head.content) == (200, b"")


async def test_both_encodings_are_revalidated_and_changed_files_resent(
    panel: Path, serve: Any
) -> None:
    async with serve() as served:
        tags = []
        for coding in ("identity", "gzip"):
            answer, _ = await sent(served.http, "/static/long.js", **{"accept-encoding": coding})
            tags.append(answer.headers["etag"])
        # The two bodies differ, so the compressed one has a weak tag.
        assert tags[1] == f"W/{tags[0]}"
        for tag in tags:
            again, body = await sent(served.http, "/static/long.js", **{"if-none-match": tag})
            assert (again.status_code, body) == (304, b"")
        (panel / "long.js").write_text(LONG + "// more")
        changed, body = await sent(served.http, "/static/long.js", **{"if-none-match": tags[1]})
        assert changed.status_code == 200
        assert gzip.decompress(body).endswith(b"// more")


async def test_long_answers_are_compressed_for_clients_that_accept_it(serve: Any) -> None:
    async with serve() as served:
        path = "/api/parameters/schema"
        plain, whole = await sent(served.http, path, **{"accept-encoding": "identity"})
        assert "content-encoding" not in plain.headers
        answer, body = await sent(served.http, path, **{"accept-encoding": "gzip"})
        assert answer.headers["content-encoding"] == "gzip"
        assert "Accept-Encoding" in answer.headers["vary"]
        assert int(answer.headers["content-length"]) == len(body) < len(whole) / 3
        assert gzip.decompress(body) == whole
        short, body = await sent(served.http, "/api/nothing", **{"accept-encoding": "gzip"})
        assert short.status_code == 404
        assert "content-encoding" not in short.headers
        assert int(short.headers["content-length"]) == len(body)
