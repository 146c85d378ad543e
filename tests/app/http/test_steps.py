"""The paper's method step by step on one pair, over REST."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from typing import Any

import cv2
import numpy as np
import psutil
import pytest

from observer.robots.contract import RobotPort

_LAB = {"source": "simulated:lab", "frame": 40}
_THRESHOLD = "flow.residual_threshold_px"


def _numbers(step: dict[str, Any]) -> dict[str, float | None]:
    return {number["name"]: number["value"] for number in step["numbers"]}


async def test_one_pair_gives_nine_steps(http: Any, peer: Any) -> None:
    opened = len(peer.commands)
    answer = await http.get("/api/steps", params=_LAB, timeout=90)
    assert answer.status_code == 200, answer.text
    told = answer.json()
    assert [step["number"] for step in told["steps"]] == list(range(1, 10))
    assert (told["source"], told["frame"], told["preset"]) == ("simulated:lab", 40, "paper")
    assert told["first_frame"] == 40 - 1 - 3 - 2
    assert told["values"] == told["preset_values"]
    assert told["truth"] is True
    assert all(step["missing"] is None for step in told["steps"])
    known = set(told["values"])
    for step in told["steps"]:
        assert set(step["parameters"]) <= known
        for part in step["formula"]:
            assert ElementTree.fromstring(part).tag.endswith("math")
    last = _numbers(told["steps"][8])
    assert last["#1: true speed"] == pytest.approx(0.4, abs=0.01)
    assert last["#1: error"] == pytest.approx(last["#1: speed"] - last["#1: true speed"])
    # The open source is left alone.
    assert len(peer.commands) == opened
    assert (await http.get("/api/parameters")).json()["preset"] == "default"


async def test_a_parameter_changes_the_numbers_and_the_picture(http: Any) -> None:
    before = (await http.get("/api/steps", params=_LAB, timeout=90)).json()
    changed = {**_LAB, f"p.{_THRESHOLD}": "9.5"}
    after = (await http.get("/api/steps", params=changed)).json()
    assert after["values"][_THRESHOLD] == 9.5
    assert after["preset_values"] == before["values"]
    few, many = (_numbers(told["steps"][5])["Dynamic"] for told in (after, before))
    assert few < many / 4
    pictures = [
        (await http.get("/api/steps/6.svg", params={**each, "labelled": "false"}, timeout=60))
        for each in (_LAB, changed, _LAB)
    ]
    assert pictures[0].content != pictures[1].content
    assert pictures[0].content == pictures[2].content


async def test_every_step_can_be_exported(http: Any) -> None:
    for number in range(1, 10):
        answer = await http.get(f"/api/steps/{number}.csv", params=_LAB, timeout=90)
        assert answer.headers["content-type"].startswith("text/csv")
        header, *rows = answer.text.splitlines()
        assert rows, number
        assert all(len(row.split(",")) == len(header.split(",")) for row in rows)
    png = await http.get("/api/steps/9.png", params=_LAB, timeout=60)
    picture = cv2.imdecode(np.frombuffer(png.content, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    assert picture.shape[1] > 1200
    pdf = await http.get("/api/steps/9.pdf", params=_LAB, timeout=60)
    assert pdf.content.startswith(b"%PDF")
    plain, labelled = [
        (await http.get("/api/steps/9.svg", params={**_LAB, "labelled": each}, timeout=60))
        for each in ("false", "true")
    ]
    assert "unsafe-inline" in plain.headers["content-security-policy"]
    assert b"9. Obstacles" not in plain.content
    assert b"9. Obstacles" in labelled.content


async def test_the_open_source_is_the_default(http: Any) -> None:
    told = (await http.get("/api/steps", timeout=90)).json()
    assert told["source"] == "simulated:lab"
    assert 0 < told["frame"] < told["frame_count"]
    again = (await http.get("/api/steps", params={"frame": told["frame"]})).json()
    assert again == told


@pytest.mark.parametrize(
    ("choice", "place", "words"),
    [
        ({"source": "camera:0,1"}, "source", "record a run"),
        ({"source": "coppeliasim:localhost:23000"}, "source", "record a run"),
        ({"source": "/etc"}, "source", "has not been opened on this server yet"),
        ({"source": "simulated:nowhere"}, "source", "nowhere"),
        ({"source": "run:none"}, "source", "no run none"),
        ({"frame": 99_999}, "frame", "its frames are 0 to"),
        ({"frame": 0}, "frame", "no earlier one"),
        ({"frame": "soon"}, "frame", "whole number"),
        ({"preset": "mine"}, "preset", "no preset"),
        ({"preset": "default"}, "preset", "paper"),
        ({"p.ego_motion.model": "rigid"}, "ego_motion.model", "affine"),
        ({f"p.{_THRESHOLD}": "900"}, _THRESHOLD, "from 0.1 to 30"),
        ({"p.flow.threshold": "1"}, "flow.threshold", "no such parameter"),
        ({"p.evidence.threshold": "1"}, "evidence.threshold", ""),
        ({"p.guard.enabled": "true"}, "guard.enabled", ""),
    ],
)
async def test_an_invalid_choice_is_refused_with_a_reason(
    http: Any, choice: dict[str, Any], place: str, words: str
) -> None:
    answer = await http.get("/api/steps", params=choice, timeout=90)
    assert answer.status_code == 422, answer.text
    (problem,) = answer.json()["detail"]
    assert problem["loc"][-1] == place, problem
    assert words in problem["msg"]


async def test_unknown_steps_and_formats_are_refused(http: Any) -> None:
    for file in ("0.png", "10.png", "4.gif"):
        assert (await http.get(f"/api/steps/{file}", params=_LAB)).status_code == 422


async def test_an_armed_robot_has_priority(
    serve: Any, peer: Any, drive: Any, eventually: Any
) -> None:
    peer.world = "simulated:lab/1"
    peer.robots = (RobotPort("observer", "socket://127.0.0.1:5001", "amigo-sh", "a robot"),)
    async with serve() as served:
        await eventually(lambda: drive.robots)
        assert (await served.http.get("/api/steps", params=_LAB, timeout=90)).is_success
        assert (await served.http.post("/api/robots/observer/arm", json={})).is_success
        # Cached results are still returned.
        assert (await served.http.get("/api/steps", params=_LAB)).is_success
        refused = await served.http.get("/api/steps/4.png", params=_LAB)
        assert refused.status_code == 409
        assert "disarm" in refused.json()["detail"]


async def test_the_process_ends_when_idle_and_restarts(
    served: Any, eventually: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.server.steps.manager._IDLE_S", 0.1)
    for frame in (20, 30):
        answer = await served.http.get("/api/steps", params={**_LAB, "frame": frame}, timeout=90)
        assert answer.is_success
        await eventually(lambda: not _workers())


def _workers() -> list[psutil.Process]:
    mine = psutil.Process().children(recursive=True)
    return [each for each in mine if _is_worker(each)]


def _is_worker(process: psutil.Process) -> bool:
    try:
        return "app.workers.steps" in process.cmdline()
    except psutil.NoSuchProcess:
        # It has ended, whether or not its parent has noticed.
        return False
