"""Calibrating with the real engine: captured views outlive it."""

from __future__ import annotations

import asyncio
import os
import signal
from pathlib import Path
from typing import Any

import pytest

from app.http.server import create_app
from app.settings import Settings

from .wire import calibrating


@pytest.mark.patient
async def test_views_survive_a_killed_engine_and_numbering_continues(
    serve_app: Any, token: str, tmp_path: Path
) -> None:
    settings = Settings(data=tmp_path)

    async with asyncio.timeout(100), serve_app(create_app(settings, token), settings) as served:
        http = served.http

        async def views(count: int) -> list[str]:
            while True:
                told = await calibrating(http)
                names = [view["name"] for view in told["views"]]
                if len(names) >= count:
                    return names
                await asyncio.sleep(0.05)

        body = {"source": "simulated:calibration"}
        started = await http.post("/api/calibrating", json=body)
        assert started.status_code == 201, started.text
        await views(2)
        # From here on captured by hand, so that the numbers are known.
        await http.patch("/api/calibrating", json={"automatic": False})
        before = await views(2)
        assert before == [str(k + 1) for k in range(len(before))]
        status = (await http.get("/api/status")).json()
        assert status["engine"]["state"] == "calibrating"
        os.kill(status["engine"]["pid"], signal.SIGKILL)
        while True:
            status = (await http.get("/api/status")).json()
            if status["engine"]["generation"] == 2:
                assert [v["name"] for v in status["calibrating"]["views"]] == before
                if status["engine"]["state"] == "calibrating":
                    break
            await asyncio.sleep(0.05)
        assert status["calibrating"]["automatic"] is False
        while not (await http.patch("/api/calibrating", json={"capture": True})).is_success:
            await asyncio.sleep(0.1)
        names = await views(len(before) + 1)
        assert names == [*before, str(len(before) + 1)]
        jpeg = await http.get(f"/api/calibrating/views/{before[0]}/left.jpg")
        assert jpeg.content.startswith(b"\xff\xd8")
        left = (await http.delete("/api/calibrating")).json()
        assert left["engine"]["state"] == "preview"
        assert left["source"]["spec"] == "simulated:lab"
