"""The observer's goal by REST."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from pydantic import TypeAdapter

from app.contract.drive import StartGoal, StopGoal, TakeLease
from app.contract.robots import GoalNow
from observer.navigation.plan import RefusedPath


@pytest.mark.usefixtures("served")
async def test_a_goal_is_started_shown_and_cancelled(http: Any, drive: Any) -> None:
    lease = await drive.request(TakeLease("observer", "Ann"))
    answer = await http.post("/api/goal", json={"ahead_m": 3, "left_m": -0.5, "lease": lease})
    assert answer.status_code == 200, answer.text
    goal = TypeAdapter(GoalNow).validate_python(answer.json())
    assert (goal.state, goal.place, goal.risk_per_metre) == ("driving", (3.0, -0.5), 0.001)
    assert drive.of(StartGoal)[-1] == StartGoal(lease, 3.0, -0.5, 0.001)
    assert (await http.get("/api/robots")).json()["goal"]["place"] == [3.0, -0.5]
    told = (await http.delete("/api/goal")).json()
    assert told["goal"]["state"] == "ended"
    assert drive.of(StopGoal)


@pytest.mark.usefixtures("served")
async def test_refused_paths_are_reported_with_the_goal(http: Any, drive: Any) -> None:
    lease = await drive.request(TakeLease("observer", "Ann"))
    await http.post("/api/goal", json={"ahead_m": 3, "lease": lease})
    refused = RefusedPath(0.0, 0.5, ((0.1, 0.0), (2.0, 0.0)), "risk", 0.04, 3, 1.2)
    drive.goal = replace(
        drive.goal, waits_for=3, meets_s=1.2, meets_at=(0.9, 0.1), refused=[refused]
    )
    drive.tell()
    goal = (await http.get("/api/robots")).json()["goal"]
    assert goal["meets_at"] == [0.9, 0.1]
    assert TypeAdapter(RefusedPath).validate_python(goal["refused"][0]) == refused


@pytest.mark.usefixtures("served")
async def test_a_goal_without_a_risk_uses_the_current_parameter(http: Any, drive: Any) -> None:
    lease = await drive.request(TakeLease("observer", "Ann"))
    await http.patch("/api/parameters", json={"navigation.risk_per_metre": 0.01})
    for told, taken in (
        ({}, 0.01),
        ({"risk_per_metre": None}, 0.01),
        ({"risk_per_metre": 0.1}, 0.1),
    ):
        await http.post("/api/goal", json={"ahead_m": 1.0, "lease": lease, **told})
        assert drive.of(StartGoal)[-1].risk_per_metre == taken


@pytest.mark.usefixtures("served")
@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({"ahead_m": 1.0}, "lease"),
        ({"left_m": 1.0, "lease": "x"}, "ahead_m"),
        ({"ahead_m": 21.0, "lease": "x"}, "ahead_m"),
        ({"ahead_m": "1", "lease": "x"}, "ahead_m"),
        ({"ahead_m": 1.0, "lease": "x", "risk_per_metre": 0.0}, "risk_per_metre"),
        ({"ahead_m": 1.0, "lease": "x", "risk_per_metre": 2.0}, "risk_per_metre"),
        ({"ahead_m": 1.0, "lease": "x", "y": 2.0}, "y"),
    ],
)
async def test_an_invalid_goal_is_refused_naming_the_field(
    http: Any, drive: Any, body: dict[str, Any], field: str
) -> None:
    answer = await http.post("/api/goal", json=body)
    assert answer.status_code == 422
    assert answer.json()["detail"][0]["loc"][-1] == field
    assert not drive.of(StartGoal)


@pytest.mark.usefixtures("served")
async def test_a_refusal_of_the_drive_process_is_passed_on(http: Any, drive: Any) -> None:
    drive.refuse[StartGoal] = ("state", "the observer is not armed; arm it first")
    answer = await http.post("/api/goal", json={"ahead_m": 1.0, "lease": "x"})
    assert answer.status_code == 409
    assert answer.json()["detail"] == "the observer is not armed; arm it first"
