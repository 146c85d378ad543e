"""The history over REST: found, described, deleted with undo."""

from __future__ import annotations

from datetime import timedelta
from typing import Any


async def finished(served: Any, name: str) -> str:
    started = await served.http.post("/api/runs", json={"name": name})
    id = str(started.json()["id"])
    assert (await served.http.post(f"/api/runs/{id}/stop")).is_success
    return id


async def test_runs_are_found_described_and_deleted_with_undo(http: Any, served: Any) -> None:
    async def found(**query: Any) -> list[str]:
        answer = await http.get("/api/history", params=query)
        assert answer.is_success, answer.text
        return [each["name"] for each in answer.json()["runs"]]

    first, second = await finished(served, "first"), await finished(served, "second")
    change = {"name": "First ride", "tags": ["wet", "lab", "wet"], "notes": "Größe\nzwei"}
    changed = await http.patch(f"/api/runs/{first}", json=change)
    assert changed.status_code == 200, changed.text
    assert changed.json()["tags"] == ["lab", "wet"]
    assert (changed.json()["aligned"], changed.json()["rerun_of"]) == (False, None)
    assert (await http.patch(f"/api/runs/{second}", json={"tags": ["lab"]})).is_success
    for refused in ({"tags": [""]}, {"name": ""}, {"notes": 3}, {"colour": "red"}):
        assert (await http.patch(f"/api/runs/{first}", json=refused)).status_code == 422
    assert (await http.patch("/api/runs/none", json={})).status_code == 404

    assert await found() == ["second", "First ride"]
    assert await found(text="GRÖSSE ride") == ["First ride"]
    assert await found(tag=["lab", "wet"]) == ["First ride"]
    assert await found(limit=1, offset=1) == ["First ride"]
    page = (await http.get("/api/history", params={"limit": 1})).json()
    assert (page["total"], page["tags"], page["undo_days"]) == (2, {"lab": 2, "wet": 1}, 7)
    assert page["disk"]["used_bytes"] > 0
    assert page["disk"]["free_bytes"] > 0
    for wrong in ({"limit": 0}, {"text": "a\0"}, {"tag": "\0"}):
        assert (await http.get("/api/history", params=wrong)).status_code == 422

    assert (await http.delete(f"/api/runs/{second}")).status_code == 204
    assert await found() == ["First ride"]
    assert [r["id"] for r in (await http.get("/api/runs")).json()] == [first]
    for method, path in (
        ("GET", ""), ("GET", "/speeds"), ("GET", "/recording"), ("DELETE", ""),
        ("PATCH", ""),
    ):  # fmt: skip
        body: dict[str, Any] = {"json": {}} if method == "PATCH" else {}
        answer = await http.request(method, f"/api/runs/{second}{path}", **body)
        assert answer.status_code == 404, (method, path)
    hidden = (await http.get("/api/history", params={"deleted": True})).json()["runs"]
    assert [each["id"] for each in hidden] == [second]
    assert hidden[0]["deleted_at"]
    back = await http.post(f"/api/runs/{second}/recover")
    assert (back.status_code, back.json()["deleted_at"]) == (200, None)
    assert await found() == ["second", "First ride"]

    assert (await http.delete(f"/api/runs/{second}")).status_code == 204
    served.server.storage.purge(timedelta(0))
    assert (await http.post(f"/api/runs/{second}/recover")).status_code == 404


async def test_renaming_the_current_run_takes_effect_immediately(http: Any, peer: Any) -> None:
    id = (await http.post("/api/runs", json={"name": "old"})).json()["id"]
    peer.observe()
    changed = await http.patch(f"/api/runs/{id}", json={"name": "new", "tags": ["x"]})
    assert (changed.json()["name"], changed.json()["frames"]) == ("new", 1)
    status = (await http.get("/api/status")).json()
    assert status["run"]["name"] == "new"
    shown = (await http.get("/api/history")).json()["runs"]
    assert (shown[0]["name"], shown[0]["frames"]) == ("new", 1)
    assert (await http.delete(f"/api/runs/{id}")).status_code == 409
    stopped = (await http.post(f"/api/runs/{id}/stop")).json()
    assert (stopped["name"], stopped["tags"]) == ("new", ["x"])
