"""Bodies above their limit: refused by their actual size, with little memory."""

from __future__ import annotations

from typing import Any

import pytest

from ..wire import UPLOAD_HEAD, upload_gigabytes
from .raw import raw_request


async def test_body_limits_apply_to_the_actual_size(serve: Any, peer: Any) -> None:
    async def many_bytes(count: int) -> Any:
        for _ in range(count):
            yield b" " * 65536

    async with serve(body_max_bytes=200_000, calibration_max_bytes=300_000) as served:
        before = len(peer.commands)
        announced = {"Content-Type": "application/json", "Content-Length": str(2 * 1024**3)}
        answer = await raw_request(served.port, "PATCH", "/api/parameters", announced)
        assert b" 413 " in answer.splitlines()[0]
        for path, method in (
            ("/api/parameters", "PATCH"),
            ("/api/runs", "POST"),
            ("/sign-in", "POST"),
        ):
            kind = "application/x-www-form-urlencoded" if path == "/sign-in" else "application/json"
            status = await stream(served, method, path, kind, many_bytes(10))
            assert status == 413, path
        boundary = "multipart/form-data; boundary=x"

        async def upload() -> Any:
            yield UPLOAD_HEAD
            async for part in many_bytes(10):
                yield part

        assert await stream(served, "POST", "/api/calibrations", boundary, upload()) == 413
        assert len(peer.commands) == before
        assert (await served.http.get("/api/status")).is_success


@pytest.mark.parametrize("announced", [True, False])
async def test_a_huge_upload_uses_little_memory(served: Any, token: str, announced: bool) -> None:
    line, taken = await upload_gigabytes(
        served.port, "/api/calibrations", token, announced=announced
    )
    assert b" 413 " in line
    assert taken < 20 * 1024**2
    assert (await served.http.get("/api/status")).is_success


async def stream(served: Any, method: str, path: str, kind: str, body: Any) -> int:
    """Return the status that answers a body without a stated length."""
    headers = {"Content-Type": kind}
    answer = await served.http.request(method, path, content=body, headers=headers)
    return int(answer.status_code)
