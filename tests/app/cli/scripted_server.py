"""A server that follows a script, over real sockets, with robots that obey instantly."""

from __future__ import annotations

import asyncio
import json
import math
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import uvicorn
from fastapi import FastAPI, HTTPException, Request, WebSocket
from starlette.websockets import WebSocketDisconnect

from app.http.gate.strangers import Strangers
from app.http.run_server import server_config
from app.settings import Settings
from observer.motion_profiles.playing import duration_s, velocity_at
from observer.motion_profiles.profile import MotionProfile
from observer.motion_profiles.profile_file import profile_from_text

TOKEN = "a-token-of-the-tests-with-256-bits-more-or-less"
# Seconds: the most its clock advances between two readings, so a stall skips nothing.
LONGEST_STEP_S = 0.1
MINE = """
name: mine
steps:
  obstacle: [{seconds: 0.6, speed_mps: 0.5}]
  observer: [{seconds: 0.8, speed_mps: -0.1}]
"""


class ScriptedServer:
    """Answers like the real one, with robots that obey instantly.

    Attributes:
        takeover: who held the roles before. refuse_arm: the sentence with which arming is refused.
        fresh_s: how long a sign of presence counts.
        act: called with the time since the programme began, whenever the facts are made.
        calls: REST calls as (method, path). said: messages of the operator, with arrival times.
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
        self.programme: tuple[MotionProfile, dict[str, Any], float] | None = None
        # Sentences of the goal's facts, one per request; the last one ends the goal.
        self.way_to_goal = ["Driving to the goal, 1.0 m away.", "The goal is reached."]
        self.goal: dict[str, Any] | None = None
        # The goal before, which this many requests after the new one still get.
        self.goal_before: dict[str, Any] | None = None
        self.late_facts = 0
        self.stopped: dict[str, Any] | None = None
        self.why: dict[str, str | None] = {"observer": None, "obstacle": None}
        self.driven_m = {"observer": 0.0, "obstacle": 0.0}
        self.updated = 0.0
        self.ended_at: float | None = None
        self.socket: WebSocket | None = None
        self.silent = False
        self.fresh_s = 3.0
        self._now, self._looked = 0.0, time.monotonic()
        self._routes()

    def told(self, kind: str) -> list[dict[str, Any]]:
        return [message for _, message in self.said if message["type"] == kind]

    def end(self, why: str | None) -> None:
        self.programme = None
        self.ended_at = time.monotonic()
        self.why = dict.fromkeys(self.why, why)

    def clock(self) -> float:
        """Return real time, as long as it is read often enough."""
        before, self._looked = self._looked, time.monotonic()
        self._now += min(self._looked - before, LONGEST_STEP_S)
        return self._now

    def facts(self) -> dict[str, Any]:
        now = self.clock()
        playing, velocity = None, dict.fromkeys(self.driven_m, 0.0)
        if self.programme is not None:
            self.act(now - self.programme[2])
        if self.programme is not None:
            programme, asked, began = self.programme
            repeat, reverse = asked["repeat"], asked["reverse"]
            since = now - self.fresh_s
            late = [r for r in programme.roles if self.present.get(r, -math.inf) < since]
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
        for each, speed in velocity.items():
            self.driven_m[each] += speed * (now - self.updated)
        self.updated = now
        robots = {
            role: {
                "state": "armed" if role in self.armed else "disarmed",
                "why": self.why[role],
                "commanded": {"speed_mps": speed, "turn_rate_radps": 0.0},
                "sent": {"speed_mps": speed, "turn_rate_radps": 0.0},
                "report": {
                    "speed_mps": speed,
                    "odometry": {"x": self.driven_m[role], "y": 0.0, "yaw": 0.0},
                },
            }
            for role, speed in velocity.items()
        }
        return {
            "stopped": self.stopped,
            "programme": playing,
            "goal": self._gone_on(),
            "robots": robots,
        }

    def _gone_on(self) -> dict[str, Any] | None:
        if self.goal is None or self.late_facts > 0:
            self.late_facts -= self.goal is not None
            return self.goal_before
        if self.goal["state"] == "driving":
            sentence = self.way_to_goal.pop(0)
            reached = "reached" in sentence
            over = "reached" if reached else "driving" if self.way_to_goal else "ended"
            self.goal = {**self.goal, "sentence": sentence, "state": over}
        return self.goal

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
            self.kept[profile_from_text(body["text"]).name] = body["text"]
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
            chosen = profile_from_text(self.kept[body["name"]])
            self.programme = (chosen, body, self.clock())
            return {}

        @app.delete("/api/robots/programme")
        async def end_programme() -> Any:
            if self.programme is None:
                raise HTTPException(409, "no programme is running")
            self.end("ended")
            return {}

        @app.post("/api/goal")
        async def go(body: dict[str, Any]) -> Any:
            assert body.pop("lease") == self.leases["observer"]
            assert "observer" in self.armed
            self.goal = {
                "state": "driving", "sentence": "", "distance_m": 1.0, "elapsed_s": 0.5,
                "risk_per_metre": 0.001, **body,
            }  # fmt: skip
            return self.goal

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
                self.present[role] = self.clock()
            case "release":
                self.leases.pop(role)
                self.armed.discard(role)

    def lose(self, **more: Any) -> None:
        """Tell the operator that someone else took the obstacle; call it from the server's loop."""
        assert self.socket is not None
        self.act = lambda _: None
        self.armed.discard("obstacle")
        message = {"type": "lease", "role": "obstacle", "state": "lost", "lease": None,
                   "holder": "Ann", "sentence": None, **more}  # fmt: skip
        self._tasks = asyncio.ensure_future(self.socket.send_json(message))


@contextmanager
def running(script: ScriptedServer) -> Iterator[ScriptedServer]:
    config = server_config(script.app, Settings(), Strangers(time.monotonic))
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
