"""The log: past entries over REST, new ones over the live socket."""

from __future__ import annotations

import asyncio
import json
from typing import Any


async def test_runs_and_refusals_are_logged_and_sent_to_pages(served: Any) -> None:
    async with served.socket("/api/live") as socket:

        async def told(part: str) -> dict[str, Any]:
            async with asyncio.timeout(10):
                while True:
                    message = json.loads(await socket.recv())
                    if message["type"] != "log":
                        continue
                    for entry in message["entries"]:
                        if part in entry["text"]:
                            return dict(entry)

        made = await served.http.post(
            "/api/runs", json={"name": "first", "source": "simulated:lab"}
        )
        assert made.status_code == 201
        started = await told('Run "first" started.')
        assert started["severity"] == "info"
        again = await served.http.post("/api/runs", json={"source": "simulated:lab"})
        assert again.status_code == 409
        refused = await told("Refused: the run first")
        assert refused["severity"] == "warning"
        await served.http.post(f"/api/runs/{made.json()['id']}/stop")
        ended = await told('Run "first" ended.')
    page = (await served.http.get("/api/log")).json()["entries"]
    numbers = [entry["number"] for entry in page]
    assert numbers == list(range(1, len(page) + 1))
    assert {started["number"], refused["number"], ended["number"]} <= set(numbers)
    assert page[0]["text"] == "Server started."
    rest = (await served.http.get("/api/log", params={"after": started["number"]})).json()[
        "entries"
    ]
    assert rest == page[started["number"] :]


async def test_a_refused_read_is_not_logged(served: Any) -> None:
    before = (await served.http.get("/api/log")).json()
    assert (await served.http.get("/api/runs/none")).status_code == 404
    assert (await served.http.get("/api/log")).json() == before
