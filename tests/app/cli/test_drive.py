"""``dynamic-observer drive`` against a server that follows a script, over real sockets."""

from __future__ import annotations

import asyncio
import json
import statistics
from itertools import pairwise
from pathlib import Path

import pytest

from app.cli import main
from observer.motion_profiles.profile_file import profile_from_text

from .scripted_server import TOKEN, ScriptedServer, running


class Shell:
    """Runs the command line within this process and keeps what it said."""

    def __init__(self, server: ScriptedServer, capsys: pytest.CaptureFixture[str]) -> None:
        self._server = server
        self._capsys = capsys

    def __call__(self, *arguments: str, token: str = TOKEN) -> tuple[int, str, str]:
        given = ["--server", f"http://127.0.0.1:{self._server.port}", "--token", token]
        with pytest.raises(SystemExit) as left:
            main(["drive", *arguments, *given])
        said = self._capsys.readouterr()
        return int(left.value.code or 0), said.out, said.err


@pytest.fixture
def shell(server: ScriptedServer, capsys: pytest.CaptureFixture[str]) -> Shell:
    return Shell(server, capsys)


def gaps(server: ScriptedServer, role: str) -> list[float]:
    """Seconds between one sign of presence and the next."""
    times = [t for t, m in server.said if m["type"] == "present" and m["role"] == role]
    return [b - a for a, b in pairwise(times)]


def test_drive_takes_control_arms_runs_the_programme_and_disarms(
    server: ScriptedServer, shell: Shell
) -> None:
    code, out, err = shell("mine", "--json", "--repeat", "2")
    assert code == 0, err
    told = json.loads(out)
    assert out.count("\n") == 1
    assert (told["programme"], told["repeat"], told["finished"], told["reason"]) == (
        "mine", 2, True, None,
    )  # fmt: skip
    assert told["duration_s"] == told["elapsed_s"] == pytest.approx(1.6)
    obstacle, observer = told["robots"]["obstacle"], told["robots"]["observer"]
    # 2 x 0.6 s at 0.5 m/s, sampled ten times a second.
    for distance in ("commanded_distance_m", "sent_distance_m", "encoder_distance_m"):
        assert obstacle[distance] == pytest.approx(0.6, abs=0.25)
        assert observer[distance] == pytest.approx(0.16, abs=0.07)
    assert obstacle["commanded_speed_max_mps"] == obstacle["encoder_speed_max_mps"] == 0.5
    assert observer["sent_speed_max_mps"] == 0.1
    # The order matters.
    steps = [call for call in server.calls if call[1] != "/robots"]
    assert steps == [
        ("GET", "/programmes/mine"),
        ("POST", "/robots/observer/arm"),
        ("POST", "/robots/obstacle/arm"),
        ("POST", "/robots/programme"),
        ("DELETE", "/robots/programme"),
        ("POST", "/robots/observer/disarm"),
        ("POST", "/robots/obstacle/disarm"),
    ]
    assert not server.armed
    assert not server.leases
    assert [m["role"] for m in server.told("take")] == ["observer", "obstacle"]
    assert not any(m["takeover"] for m in server.told("take"))
    assert [m["role"] for m in server.told("release")] == ["observer", "obstacle"]
    for role in ("observer", "obstacle"):
        numbers = [m["sequence"] for m in server.told("present") if m["role"] == role]
        assert numbers == list(range(1, len(numbers) + 1))
        assert statistics.median(gaps(server, role)) == pytest.approx(0.1, abs=0.05)
    assert {m["id"] for m in server.told("pong")} >= set(range(10))


def test_a_programme_file_is_uploaded_and_driven_in_reverse(
    server: ScriptedServer, shell: Shell, tmp_path: Path
) -> None:
    file = tmp_path / "other.yaml"
    file.write_text("steps: {obstacle: [{seconds: 0.5, speed_mps: 0.4}]}")
    code, out, err = shell(str(file), "--reverse", "--json")
    assert code == 0, err
    assert "other is finished" in err
    assert profile_from_text(server.kept["other"]).roles == ("obstacle",)
    assert json.loads(out)["reverse"] is True
    assert server.driven_m["obstacle"] == pytest.approx(-0.2, abs=0.1)
    assert [m["role"] for m in server.told("take")] == ["obstacle"]


def test_another_operator_is_not_displaced_without_takeover(
    server: ScriptedServer, shell: Shell
) -> None:
    server.holder = "Ann"
    code, out, err = shell("mine")
    assert (code, out) == (1, "")
    assert "Ann controls the observer; use --takeover to take control" in err
    # Nothing of Ann's was touched.
    assert [call for call in server.calls if call[0] != "GET"] == []
    assert shell("mine", "--takeover")[0] == 0
    assert all(m["takeover"] for m in server.told("take")[1:])


def test_an_arming_refusal_is_shown_in_the_servers_words(
    server: ScriptedServer, shell: Shell
) -> None:
    server.refuse_arm = "the observer has no rig; say where its cameras are first"
    code, out, err = shell("mine", "--json")
    assert code == 1
    assert "the observer has no rig; say where its cameras are first" in err
    told = json.loads(out)
    assert (told["finished"], told["elapsed_s"]) == (False, 0)
    assert told["robots"]["observer"]["encoder_distance_m"] is None
    assert ("POST", "/robots/programme") not in server.calls
    assert len(server.told("release")) == 2


def test_a_programme_that_never_starts_is_not_reported_as_driven(
    server: ScriptedServer, shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.client.profile_drive.APPEARS_WITHIN_S", 0.9)
    server.act = lambda _: server.end("nobody was present for the observer")
    code, _, err = shell("mine")
    assert code == 1
    assert "mine ended after 0.0 of 0.8 s: nobody was present for the observer" in err


def test_a_stop_by_another_operator_ends_the_drive_and_names_them(
    server: ScriptedServer, shell: Shell
) -> None:
    def stop(elapsed: float) -> None:
        if elapsed > 0.25:
            server.stopped = {"by": "Ann", "since": 0.0}
            server.end("stopped by Ann")

    server.act = stop
    code, out, err = shell("mine", "--json")
    assert code == 1
    assert "mine ended after 0." in err
    assert "stopped by Ann" in err
    assert json.loads(out)["finished"] is False


def test_a_takeover_ends_the_drive(server: ScriptedServer, shell: Shell) -> None:
    server.act = lambda elapsed: server.lose() if elapsed > 0.25 else None
    code, _, err = shell("mine")
    assert code == 1
    assert "Ann took control of the obstacle" in err
    # The operator gives back the remaining role; Ann keeps hers.
    assert [m["role"] for m in server.told("release")] == ["observer"]
    assert ("POST", "/robots/observer/disarm") in server.calls
    assert ("POST", "/robots/obstacle/disarm") not in server.calls
    assert "observer" not in server.armed


def test_a_lost_server_ends_the_drive_with_a_one_line_error(
    capsys: pytest.CaptureFixture[str],
) -> None:
    script = ScriptedServer()
    with running(script) as server:

        def hang_up(elapsed: float) -> None:
            if elapsed > 0.25 and server.socket is not None:
                server.act = lambda _: None
                server._tasks = asyncio.ensure_future(server.socket.close(1011))

        server.act = hang_up
        code, _, err = Shell(server, capsys)("mine")
    assert code == 1
    assert "the connection to the server was lost" in err
    assert err.count("\n") == 1


def test_a_server_that_grants_no_lease_times_out(
    server: ScriptedServer, shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.client.operator_socket._ANSWER_WITHIN_S", 0.3)
    server.silent = True
    code, _, err = shell("mine")
    assert code == 1
    assert "did not grant control of the observer" in err


def test_stop_without_a_programme_stops_all_robots(server: ScriptedServer, shell: Shell) -> None:
    code, out, err = shell("--stop")
    assert (code, out) == (0, "")
    assert "all robots are stopped" in err
    assert server.stopped is not None
    assert server.calls == [("POST", "/robots/stop")]


def test_invalid_arguments_move_nothing(server: ScriptedServer, shell: Shell) -> None:
    for arguments, sentence in (
        ([], "name a programme to run, or give only --stop"),
        (["mine", "--stop"], "name a programme to run, or give only --stop"),
        (["none"], "there is no programme 'none'; there are mine"),
        (["../robots"], "there is no programme file ../robots"),
        (["none.yaml"], "there is no programme file none.yaml"),
        (["mine", "--repeat", "0"], "1 to 1000 times, not 0"),
        (["mine", "--token-file", "x"], "not both"),
        (["mine", "--speed", "3"], "--help"),
    ):
        code, out, err = shell(*arguments)
        assert (code, out) == (2, "")
        assert sentence in err
        assert err.count("\n") == 1
    assert not server.said


def test_a_wrong_token_or_address_is_reported(
    shell: Shell, capsys: pytest.CaptureFixture[str], free_port: int
) -> None:
    assert shell("mine", token="wrong")[0] == 2
    for address, code, sentence in (
        (f"http://127.0.0.1:{free_port}", 1, "start the server with dynamic-observer serve"),
        ("ftp://x", 2, "is not a server address"),
        ("http://127.0.0.1:99999", 2, "is not a server address"),
        ("http://127.0.0.1/api", 2, "give only the address of the server"),
    ):
        with pytest.raises(SystemExit) as left:
            main(["drive", "mine", "--token", "x", "--server", address])
        assert left.value.code == code
        assert sentence in capsys.readouterr().err
    with pytest.raises(SystemExit) as left:
        main(["drive", "mine"])
    assert left.value.code == 2
    assert "a token is needed" in capsys.readouterr().err
