"""``dynamic-observer drive`` against a server that follows a script, over real sockets."""

from __future__ import annotations

import asyncio
import json
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import uvicorn
from fastapi import FastAPI, HTTPException, Request, WebSocket
from starlette.websockets import WebSocketDisconnect

from app.cli import main
from app.settings import Settings
from app.web.run_server import server_config
from observer.errors import InputError
from observer.programmes.playing import duration_s, velocity_at
from observer.programmes.programme import Programme
from observer.programmes.programme_file import programme_from_text

TOKEN = "a-token-of-the-tests-with-256-bits-more-or-less"
FRESH_S = 0.25
MINE = """
name: mine
steps:
  obstacle: [{seconds: 0.6, speed_mps: 0.5}]
  observer: [{seconds: 0.8, speed_mps: -0.1}]
"""


class ScriptedServer:
    """Answers as the real one, with robots that do at once what they are told.

    Attributes:
        takeover: who held the roles before. refuse_arm: the sentence, where arming is refused.
        act: called with the time since the programme began, every tick of the facts.
        calls: REST calls as (method, path). said: messages of the operator, with their arrival.
    """

    def __init__(self) -> None:
        self.app = FastAPI()
        self.port = 0
        self.kept = {"mine": MINE}
        self.holder: str | None = None
        self.refuse_arm: str | None = None
        self.act: Callable[[float], None] = lambda _: None
        self.calls: list[tuple[str, str]] = []
        self.said: list[tuple[float, dict[str, Any]]] = []
        self.leases: dict[str, str] = {}
        self.armed: set[str] = set()
        self.present: dict[str, float] = {}
        self.programme: tuple[Programme, dict[str, Any], float] | None = None
        self.stopped: dict[str, Any] | None = None
        self.why: dict[str, str | None] = {"observer": None, "obstacle": None}
        self.way = {"observer": 0.0, "obstacle": 0.0}
        self.updated = time.monotonic()
        self.ended_at: float | None = None
        self.socket: WebSocket | None = None
        self.silent = False
        self._routes()

    def told(self, kind: str) -> list[dict[str, Any]]:
        return [message for _, message in self.said if message["type"] == kind]

    def end(self, why: str | None) -> None:
        self.programme = None
        self.ended_at = time.monotonic()
        self.why = dict.fromkeys(self.why, why)

    def facts(self) -> dict[str, Any]:
        now = time.monotonic()
        playing, velocity = None, dict.fromkeys(self.way, 0.0)
        if self.programme is not None:
            self.act(now - self.programme[2])
        if self.programme is not None:
            programme, asked, began = self.programme
            repeat, reverse = asked["repeat"], asked["reverse"]
            late = [r for r in programme.roles if now - self.present.get(r, 0.0) > FRESH_S]
            if late:
                self.end(f"nobody was present for the {late[0]}")
            elif now - began >= duration_s(programme, repeat):
                self.end(None)
            else:
                elapsed = now - began
                playing = {
                    "name": programme.name, "elapsed_s": elapsed, "phase": "driving",
                    "duration_s": duration_s(programme, repeat), "round": 1, "repeat": repeat,
                    "reverse": reverse,
                }  # fmt: skip
                for role in programme.roles:
                    wanted = velocity_at(programme, role, elapsed, repeat=repeat, reverse=reverse)
                    velocity[role] = wanted[0] if wanted else 0.0
        for role, speed in velocity.items():
            self.way[role] += speed * (now - self.updated)
        self.updated = now
        robots = {
            role: {
                "state": "armed" if role in self.armed else "disarmed",
                "why": self.why[role],
                "commanded": {"speed_mps": speed, "turn_rate_radps": 0.0},
                "sent": {"speed_mps": speed, "turn_rate_radps": 0.0},
                "report": {
                    "speed_mps": speed,
                    "odometry": {"x": self.way[role], "y": 0.0, "yaw": 0.0},
                },
            }
            for role, speed in velocity.items()
        }
        return {"stopped": self.stopped, "programme": playing, "robots": robots}

    def _routes(self) -> None:
        app = self.app

        @app.middleware("http")
        async def gate(request: Request, call_next: Any) -> Any:
            if request.headers.get("authorization") != f"Bearer {TOKEN}":
                from fastapi.responses import JSONResponse

                return JSONResponse({"detail": "this is not the server's token"}, 401)
            self.calls.append((request.method, request.url.path.removeprefix("/api")))
            return await call_next(request)

        @app.get("/api/robots")
        async def robots() -> Any:
            return self.facts()

        @app.get("/api/programmes/{name}")
        async def programme(name: str) -> Any:
            if name not in self.kept:
                raise HTTPException(404, f"there is no programme {name!r}; there are mine")
            return {"name": name, "text": self.kept[name]}

        @app.post("/api/programmes")
        async def keep(body: dict[str, str]) -> Any:
            self.kept[programme_from_text(body["text"]).name] = body["text"]
            return {}

        @app.post("/api/robots/stop")
        async def stop() -> Any:
            self.stopped = {"by": "somebody", "since": time.monotonic()}
            self.end("stopped")
            return {}

        @app.post("/api/robots/programme")
        async def start(body: dict[str, Any]) -> Any:
            assert body["leases"] == {role: self.leases[role] for role in body["leases"]}
            assert set(body["leases"]) <= self.armed
            chosen = programme_from_text(self.kept[body["name"]])
            self.programme = (chosen, body, time.monotonic())
            return {}

        @app.delete("/api/robots/programme")
        async def end_programme() -> Any:
            if self.programme is None:
                raise HTTPException(409, "no programme is going")
            self.end("ended")
            return {}

        @app.post("/api/robots/{role}/arm")
        async def arm(role: str, body: dict[str, Any]) -> Any:
            if self.refuse_arm is not None:
                raise HTTPException(409, self.refuse_arm)
            assert body["lease"] == self.leases[role]
            self.armed.add(role)
            return {}

        @app.post("/api/robots/{role}/disarm")
        async def disarm(role: str) -> Any:
            self.armed.discard(role)
            return {}

        app.websocket("/api/drive")(self._drive)

    async def _drive(self, connection: WebSocket) -> None:
        if connection.headers.get("authorization") != f"Bearer {TOKEN}":
            await connection.close(1008)
            return
        await connection.accept()
        self.socket = connection
        pings = asyncio.create_task(self._ping(connection))
        try:
            while True:
                message = json.loads(await connection.receive_text())
                self.said.append((time.monotonic(), message))
                await self._answer(connection, message)
        except WebSocketDisconnect:
            self.leases.clear()
        finally:
            pings.cancel()

    async def _ping(self, connection: WebSocket) -> None:
        for number in range(10_000):
            await asyncio.sleep(0.1)
            await connection.send_json({"type": "ping", "id": number})

    async def _answer(self, connection: WebSocket, message: dict[str, Any]) -> None:
        role = message.get("role")
        match message["type"]:
            case "take" if self.silent:
                pass
            case "take" if self.holder and not message["takeover"]:
                await connection.send_json(
                    {"type": "lease", "role": role, "state": "refused", "lease": None,
                     "holder": self.holder, "sentence": None}
                )  # fmt: skip
            case "take":
                self.leases[role] = f"lease-of-{role}"
                await connection.send_json(
                    {"type": "lease", "role": role, "state": "yours", "lease": self.leases[role],
                     "holder": None, "sentence": None}
                )  # fmt: skip
            case "present":
                self.present[role] = time.monotonic()
            case "release":
                self.leases.pop(role)
                self.armed.discard(role)

    def lose(self, **more: Any) -> None:
        """Tell the operator that the obstacle is somebody else's; from the server's loop."""
        assert self.socket is not None
        self.act = lambda _: None
        message = {"type": "lease", "role": "obstacle", "state": "lost", "lease": None,
                   "holder": "Ann", "sentence": None, **more}  # fmt: skip
        self._tasks = asyncio.ensure_future(self.socket.send_json(message))


@contextmanager
def running(script: ScriptedServer) -> Iterator[ScriptedServer]:
    config = server_config(script.app, Settings())
    server = uvicorn.Server(config)
    server.install_signal_handlers = lambda: None  # type: ignore[attr-defined]
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        script.port = listener.getsockname()[1]
        thread = threading.Thread(target=lambda: asyncio.run(server.serve([listener])))
        thread.start()
        try:
            while not server.started:
                time.sleep(0.005)
            yield script
        finally:
            server.should_exit = True
            thread.join()


@pytest.fixture
def server() -> Iterator[ScriptedServer]:
    with running(ScriptedServer()) as script:
        yield script


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


def test_a_programme_is_taken_armed_driven_and_disarmed(
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
    # Twice 0.6 s at 0.5 m/s, and sampled ten times a second.
    for way in ("commanded_way_m", "sent_way_m", "encoder_way_m"):
        assert obstacle[way] == pytest.approx(0.6, abs=0.15)
        assert observer[way] == pytest.approx(0.16, abs=0.04)
    assert obstacle["commanded_speed_max_mps"] == obstacle["encoder_speed_max_mps"] == 0.5
    assert observer["sent_speed_max_mps"] == 0.1
    # In this order.
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
        assert sorted(gaps(server, role))[len(gaps(server, role)) // 2] == pytest.approx(
            0.1, abs=0.03
        )
    assert {m["id"] for m in server.told("pong")} >= set(range(10))


def test_a_file_is_brought_to_the_server_and_driven_in_reverse(
    server: ScriptedServer, shell: Shell, tmp_path: Path
) -> None:
    file = tmp_path / "other.yaml"
    file.write_text("steps: {obstacle: [{seconds: 0.5, speed_mps: 0.4}]}")
    code, out, err = shell(str(file), "--reverse", "--json")
    assert code == 0, err
    assert "other is driven" in err
    assert programme_from_text(server.kept["other"]).roles == ("obstacle",)
    assert json.loads(out)["reverse"] is True
    assert server.way["obstacle"] == pytest.approx(-0.2, abs=0.1)
    assert [m["role"] for m in server.told("take")] == ["obstacle"]


def test_somebody_who_drives_is_not_put_out_without_being_asked(
    server: ScriptedServer, shell: Shell
) -> None:
    server.holder = "Ann"
    code, out, err = shell("mine")
    assert (code, out) == (1, "")
    assert "Ann drives the observer; --takeover takes it over" in err
    assert not server.armed
    assert shell("mine", "--takeover")[0] == 0
    assert all(m["takeover"] for m in server.told("take")[1:])


def test_a_robot_that_cannot_be_armed_is_said_in_the_servers_words(
    server: ScriptedServer, shell: Shell
) -> None:
    server.refuse_arm = "the observer has no rig; say where its cameras are first"
    code, out, err = shell("mine", "--json")
    assert code == 1
    assert "the observer has no rig; say where its cameras are first" in err
    told = json.loads(out)
    assert (told["finished"], told["elapsed_s"]) == (False, 0)
    assert told["robots"]["observer"]["encoder_way_m"] is None
    assert ("POST", "/robots/programme") not in server.calls
    assert len(server.told("release")) == 2


def test_a_programme_that_never_goes_is_not_said_to_be_driven(
    server: ScriptedServer, shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.operating.programme_drive._APPEARS_WITHIN_S", 0.9)
    server.act = lambda _: server.end("nobody was present for the observer")
    code, _, err = shell("mine")
    assert code == 1
    assert "mine ended after 0.0 of 0.8 s: nobody was present for the observer" in err


def test_a_stop_by_somebody_else_ends_it_with_their_name(
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


def test_a_lease_that_is_taken_over_ends_it(server: ScriptedServer, shell: Shell) -> None:
    server.act = lambda elapsed: server.lose() if elapsed > 0.25 else None
    code, _, err = shell("mine")
    assert code == 1
    assert "Ann took the obstacle over" in err
    # What is left is given back.
    assert [m["role"] for m in server.told("release")] == ["observer"]
    assert not server.armed


def test_a_server_that_goes_away_ends_it_in_one_sentence(
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


def test_a_server_that_gives_no_lease_is_not_waited_for(
    server: ScriptedServer, shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.operating.operator_socket._ANSWER_WITHIN_S", 0.3)
    server.silent = True
    code, _, err = shell("mine")
    assert code == 1
    assert "did not give the observer" in err


def test_the_command_ended_by_a_signal_stops_the_robots_at_once(
    server: ScriptedServer, tmp_path: Path
) -> None:
    server.kept["mine"] = "name: mine\nsteps: {obstacle: [{seconds: 30, speed_mps: 0.5}]}"
    file = tmp_path / "token"
    file.write_text(TOKEN + "\n")
    command = [sys.executable, "-m", "app.cli", "drive", "mine", "--json", "--token-file",
               str(file), "--server", f"127.0.0.1:{server.port}"]  # fmt: skip
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        while server.programme is None or server.facts()["programme"]["elapsed_s"] < 0.3:
            assert process.poll() is None, process.communicate()
            time.sleep(0.02)
        sent = time.monotonic()
        process.terminate()
        out, err = process.communicate(timeout=20)
    released = [t for t, m in server.said if m["type"] == "release"]
    sys.stdout.write(f"released {1000 * (released[0] - sent):.0f} ms after SIGTERM" + "\n")
    assert released[0] - sent < 0.3
    assert process.returncode == 128 + signal.SIGTERM
    assert json.loads(out)["finished"] is False
    assert err == "interrupted; the robots are stopped and disarmed\n"
    assert server.programme is None
    assert not server.armed


def test_a_killed_command_leaves_nothing_that_says_it_is_there(server: ScriptedServer) -> None:
    server.kept["mine"] = "name: mine\nsteps: {obstacle: [{seconds: 30, speed_mps: 0.5}]}"
    command = [sys.executable, "-m", "app.cli", "drive", "mine", "--token", TOKEN,
               "--server", f"http://127.0.0.1:{server.port}/"]  # fmt: skip
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as process:
        while server.programme is None:
            assert process.poll() is None
            time.sleep(0.02)
        process.kill()
        process.wait()
        killed = time.monotonic()
    while server.facts()["programme"] is not None:
        assert time.monotonic() < killed + 5
        time.sleep(0.01)
    assert server.ended_at is not None
    took = 1000 * (server.ended_at - killed)
    sys.stdout.write(f"nobody present {took:.0f} ms after SIGKILL\n")
    assert server.ended_at - killed <= 0.3


def test_stop_alone_stops_all_robots(server: ScriptedServer, shell: Shell) -> None:
    code, out, err = shell("--stop")
    assert (code, out) == (0, "")
    assert "all robots are stopped" in err
    assert server.stopped is not None
    assert server.calls == [("POST", "/robots/stop")]


def test_what_is_asked_wrongly_moves_nothing(server: ScriptedServer, shell: Shell) -> None:
    for arguments, sentence in (
        ([], "name a programme to drive, or give --stop alone"),
        (["mine", "--stop"], "name a programme to drive, or give --stop alone"),
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


def test_a_wrong_token_or_address_is_said(
    shell: Shell, capsys: pytest.CaptureFixture[str], free_port: int
) -> None:
    assert shell("mine", token="wrong")[0] == 2
    for address, code, sentence in (
        (f"http://127.0.0.1:{free_port}", 1, "start the server with dynamic-observer serve"),
        ("ftp://x", 2, "is no server's address"),
        ("http://127.0.0.1:99999", 2, "is no server's address"),
        ("http://127.0.0.1/api", 2, "give the server's address alone"),
    ):
        with pytest.raises(SystemExit) as left:
            main(["drive", "mine", "--token", "x", "--server", address])
        assert left.value.code == code
        assert sentence in capsys.readouterr().err
    with pytest.raises(SystemExit) as left:
        main(["drive", "mine"])
    assert left.value.code == 2
    assert "a token is needed" in capsys.readouterr().err


def test_programmes_are_listed_and_printed(capsys: pytest.CaptureFixture[str]) -> None:
    def said(*arguments: str) -> str:
        with pytest.raises(SystemExit) as left:
            main(["programmes", *arguments])
        assert not left.value.code
        return capsys.readouterr().out

    assert "figure17_a   (14 s, observer and obstacle)" in said()
    listed = {each["name"]: each for each in json.loads(said("--json"))}
    assert listed["rig_turn"]["roles"] == ["observer"]
    assert listed["rig_turn"]["duration_s"] == 19
    assert programme_from_text(said("figure17_b")).name == "figure17_b"
    with pytest.raises(SystemExit) as left:
        main(["programmes", "none"])
    assert left.value.code == 2
    with pytest.raises(InputError, match="no name"):
        programme_from_text("steps: {observer: [{seconds: 1}]}")
