"""Source pictures as a page requests them; the page may be closed meanwhile."""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path
from typing import Any

import pytest

from app.server.source.thumbnails import Thumbnails

PICTURE = "/api/sources/picture.jpg?spec=simulated:lab"


async def test_a_picture_is_cacheable_and_cancelled_when_its_client_leaves(
    serve: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    started, ended, let = asyncio.Event(), asyncio.Event(), asyncio.Event()

    async def make(spec: str) -> bytes:
        started.set()
        try:
            await let.wait()
        finally:
            ended.set()
        return spec.encode()

    async with asyncio.timeout(30), serve() as served:
        served.server.source.thumbnails = Thumbnails(tmp_path / "pictures", make)
        with caplog.at_level(logging.WARNING):
            asking = asyncio.ensure_future(served.http.get(PICTURE))
            await started.wait()
            asking.cancel()
            await ended.wait()
            await asyncio.sleep(0.1)
        assert not [each for each in caplog.records if each.levelno >= logging.ERROR]

        let.set()
        answer = await served.http.get(PICTURE)
        assert (answer.status_code, answer.content) == (200, b"simulated:lab")
        assert answer.headers["content-type"] == "image/jpeg"
        assert answer.headers["cache-control"] == "private, max-age=86400"
