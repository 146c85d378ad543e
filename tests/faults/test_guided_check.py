"""A guided check as a user does it, in a simulated scene with a robot that really crosses."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest

from .bench import Server, served, tell, wait_until
from .operator import Operator, arm

pytestmark = [pytest.mark.slow, pytest.mark.patient, pytest.mark.timeout(300)]

SPEED_MPS = 0.25
# Simple enough for slow machines, where late frames would stop the robot.
_SMALL = "based_on: drive\ncamera: {width: 320, height: 160}\n"
TURN_RADPS = 0.6
# A robot that stands still this long despite drive commands has been stopped: stops are reported
# once it is at rest, and after a stop the operator has to let go before driving on.
_STATIONARY_S = 2.0
_PATIENCE_S = 150.0


def test_guided_check_passes_walk_in_and_closed_browser(tmp_path: Path) -> None:
    scenario = tmp_path / "small.yaml"
    scenario.write_text(_SMALL)
    with served(tmp_path, f"simulated:{scenario}") as server:
        wait_until("sight", lambda: _robots(server)["sight"]["status"] == "ok", 40.0)
        server.request("POST", "/robots/check", {"role": "observer"})
        walked_in = _walked_in(server)
        tell(f"walk in: {walked_in['verdict']}; {walked_in['sentence']}")
        assert walked_in["state"] == "passed", walked_in
        for _ in ("cover_lens", "unplug"):
            # Simulated cameras cannot be covered or unplugged.
            server.request("POST", "/robots/check/skip")
        closed = _closed_browser(server)
        tell(f"close the browser: {closed['verdict']}")
        assert closed["state"] == "passed", closed
        (entry,) = server.request("GET", "/robots/checks")
        record = server.request("GET", f"/robots/checks/{entry['name']}")
        assert record["outcome"] == "incomplete"
        assert record["robot"]["model"] is not None
        markdown = server.api.get(f"/api/robots/checks/{entry['name']}?format=markdown").text
        assert walked_in["verdict"] in markdown


def _robots(server: Server) -> dict[str, Any]:
    facts: dict[str, Any] = server.request("GET", "/robots")
    return facts


def _step(server: Server, name: str) -> dict[str, Any]:
    steps = server.request("GET", "/robots/check")["check"]["steps"]
    return next(step for step in steps if step["name"] == name)


def _walked_in(server: Server) -> dict[str, Any]:
    """Drive ahead until the guard stops the moving robot, retrying after other stops."""
    operator = Operator(server.port, server.token)
    try:
        assert operator.take(takeover=True)["state"] == "yours"
        wait_until("the guard's stop", lambda: _driven(server, operator, "walk_in"), _PATIENCE_S)
        return _step(server, "walk_in")
    finally:
        operator.leave()


def _closed_browser(server: Server) -> dict[str, Any]:
    """Turn away from the obstacle, drive, and disconnect in motion; retry until it counts."""

    def closed() -> bool:
        operator = Operator(server.port, server.token)
        try:
            assert operator.take(takeover=True)["state"] == "yours"
            operator.release()
            arm(server, operator)
            operator.hold(0.0, TURN_RADPS)
            time.sleep(2.0)
            operator.hold(SPEED_MPS)
            until = time.monotonic() + 2.0
            while _speed(server) < 0.8 * SPEED_MPS and time.monotonic() < until:
                time.sleep(0.02)
        finally:
            operator.leave(abruptly=True)
        time.sleep(1.5)
        return _settled(server, "close_browser")

    wait_until("a stop for want of an operator", closed, _PATIENCE_S)
    return _step(server, "close_browser")


def _driven(server: Server, operator: Operator, step: str) -> bool:
    """Drive once from arming to a stop; return whether that settles the step."""
    operator.release()
    arm(server, operator)
    operator.hold(SPEED_MPS)
    drove = time.monotonic()
    while not _settled(server, step) and time.monotonic() - drove < _STATIONARY_S:
        if _speed(server) > 0.1:
            drove = time.monotonic()
        time.sleep(0.05)
    return _settled(server, step)


def _settled(server: Server, name: str) -> bool:
    return _step(server, name)["state"] not in ("waiting", "driving")


def _speed(server: Server) -> float:
    return float((server.robot().get("report") or {}).get("speed_mps") or 0.0)
