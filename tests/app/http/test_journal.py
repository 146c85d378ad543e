"""The log: past entries over REST, new ones over the live socket."""

from __future__ import annotations

import asyncio
import json
from typing import Any

from app.contract.drive import IncidentEvent
from app.http.gate.admission import COOKIE_NAME


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


async def test_a_stop_is_logged_once_under_the_name_of_the_operator_at_that_browser(
    served: Any, drive: Any, token: str, eventually: Any
) -> None:
    async def stops() -> list[str]:
        entries = (await served.http.get("/api/log")).json()["entries"]
        return [each["text"] for each in entries if "stopped" in each["text"]]

    async with served.anonymous() as browser:
        await browser.get("/", params={"token": token})
        cookie = {"Cookie": f"{COOKIE_NAME}={browser.cookies[COOKIE_NAME]}"}
        async with served.socket("/api/drive", token=None, headers=cookie) as page:
            name = json.loads(await page.recv())["name"]
            drive.publish(IncidentEvent(None, "stop", f"all robots were stopped by {name}", 7, 0.3))
            await browser.post("/api/robots/stop")
            await eventually(lambda: drive.stopped)
            await eventually(lambda: served.server.driving.facts().stopped)
            assert await stops() == [f"All robots were stopped by {name}."]
            drive.publish(IncidentEvent(None, "programme", "lap was stopped: a bumper", 8, None))
            drive.publish(IncidentEvent("observer", "fault", "its motors stopped", 9, None))
            await eventually(lambda: len(served.server.driving.facts().incidents) == 3)
            assert (await stops())[1:] == [
                "Lap was stopped: a bumper.",
                "Observer: its motors stopped.",
            ]
            # With a second page it is not known which of them asks.
            async with served.socket("/api/drive", token=None, headers=cookie) as other:
                await other.recv()
                await browser.post("/api/robots/reset")
                await browser.post("/api/robots/stop")
                assert (await stops())[-1] == "All robots were stopped by an operator at 127.0.0.1."
