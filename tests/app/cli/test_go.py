"""``dynamic-observer go`` against a server that follows a script, over real sockets."""

from __future__ import annotations

import json

import pytest

from app.cli import main

from .scripted_server import TOKEN, ScriptedServer


def go(
    server: ScriptedServer, capsys: pytest.CaptureFixture[str], *arguments: str
) -> tuple[int, str, str]:
    given = ["--server", f"http://127.0.0.1:{server.port}", "--token", TOKEN]
    with pytest.raises(SystemExit) as left:
        main(["go", *given, *arguments])
    said = capsys.readouterr()
    return int(left.value.code or 0), said.out, said.err


def test_go_takes_control_arms_drives_to_the_goal_and_disarms(
    server: ScriptedServer, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = go(server, capsys, "--json", "--risk", "0.01", "--", "2.0", "-0.5")
    assert code == 0, err
    told = json.loads(out)
    assert (told["ahead_m"], told["left_m"], told["risk_per_metre"]) == (2.0, -0.5, 0.01)
    assert (told["reached"], told["reason"]) == (True, None)
    assert server.goal is not None
    assert (server.goal["ahead_m"], server.goal["left_m"]) == (2.0, -0.5)
    assert [call for call in server.calls if call[1] != "/robots"] == [
        ("POST", "/robots/observer/arm"),
        ("POST", "/goal"),
        ("POST", "/robots/observer/disarm"),
    ]
    assert "Driving to the goal, 1.0 m away." in err
    assert "the goal is reached; the robot is disarmed" in err
    assert not server.armed
    assert not server.leases


def test_the_risk_defaults_to_the_servers(
    server: ScriptedServer, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = go(server, capsys, "--json", "2.0")
    assert code == 0, err
    assert json.loads(out)["risk_per_metre"] == 0.001


def test_an_early_end_reports_its_reason_as_the_error(
    server: ScriptedServer, capsys: pytest.CaptureFixture[str]
) -> None:
    server.way_to_goal = [
        "Waiting for obstacle 3: it will cross in 1.4 s.",
        "Waiting for obstacle 3: it will cross in 1.3 s.",
        "The goal was aborted: vision is lost.",
    ]
    code, out, err = go(server, capsys, "2")
    assert code == 1
    assert out == ""
    assert err.count("Waiting for obstacle 3") == 1
    assert "The goal was aborted: vision is lost" in err.splitlines()[-1]
    assert not server.armed


@pytest.mark.parametrize("before", ["reached", "ended", None])
def test_the_end_of_the_goal_before_is_not_taken_for_its_own(
    server: ScriptedServer, capsys: pytest.CaptureFixture[str], before: str | None
) -> None:
    if before is not None:
        server.goal_before = {
            "state": before, "sentence": "It is over.", "distance_m": 0.1, "elapsed_s": 7.5,
            "risk_per_metre": 0.001,
        }  # fmt: skip
    server.late_facts = 2
    code, out, err = go(server, capsys, "--json", "2.0")
    assert code == 0, err
    told = json.loads(out)
    assert (told["reached"], told["elapsed_s"]) == (True, 0.5)
    assert "Driving to the goal, 1.0 m away." in err
    assert "It is over." not in err


def test_an_invalid_goal_is_refused_before_anything_moves(
    server: ScriptedServer, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = go(server, capsys, "ahead")
    assert code == 2
    assert "ahead" in err
    assert not server.calls
