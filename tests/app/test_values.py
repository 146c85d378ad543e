"""Values of the contract as JSON."""

from __future__ import annotations

import json
from dataclasses import replace

from app.contract.values import json_text
from observer.robots.contract import RobotPhase, RobotReport


def test_messages_are_valid_json() -> None:
    report = RobotReport(
        RobotPhase.CONNECTED, speed_mps=float("nan"), battery_v=float("inf"), warnings=("x",)
    )
    told = json.loads(json_text(report))
    assert (told["phase"], told["speed_mps"], told["battery_v"]) == ("connected", None, None)
    assert told["warnings"] == ["x"]
    # Half a surrogate pair, which a name may contain.
    assert json.loads(json_text(replace(report, name="\ud800", speed_mps=0.5, battery_v=None)))
