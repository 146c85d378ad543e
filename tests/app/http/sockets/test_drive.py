"""Manual driving over the socket: leases, command ages, and misbehaving clients."""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from app.contract.drive import DriveCommand, Presence, ReleaseLease, StopRobots, TakeLease
from observer.robots.contract import RobotPort

# A page's clock starts when the page is opened.
EPOCH = time.monotonic() - 12.0


def clock_ms() -> float:
    return 1000 * (time.monotonic() - EPOCH)


class Hand:
    """A page: answers pings, keeps what it receives, sends commands."""

    def __init__(self, socket: Any) -> None:
        self.socket = socket
        self.heard: list[dict[str, Any]] = []
        self.sequence = 0
        self._news = asyncio.Condition()

    async def listen(self) -> None:
        with contextlib.suppress(ConnectionClosed):
            while True:
                message = json.loads(await self.socket.recv())
                if message["type"] == "ping":
                    await self.say({"type": "pong", "id": message["id"], "time": clock_ms()})
                async with self._news:
                    self.heard.append(message)
                    self._news.notify_all()

    async def say(self, message: dict[str, Any] | str) -> None:
        await self.socket.send(message if isinstance(message, str) else json.dumps(message))

    async def next(self, kind: str, **fields: Any) -> dict[str, Any]:
        """Return the next message of a kind (with these fields) that was not taken yet."""
        async with asyncio.timeout(10), self._news:
            while True:
                for message in self.heard:
                    if message["type"] == kind and fields.items() <= message.items():
                        self.heard.remove(message)
                        return message
                await self._news.wait()

    async def take(self, role: str = "observer", *, takeover: bool = False) -> dict[str, Any]:
        await self.say({"type": "take", "role": role, "takeover": takeover})
        return await self.next("lease", role=role)

    async def drive(self, *, role: str = "observer", ago_ms: float = 0.0, **more: Any) -> int:
        self.sequence += 1
        message = {
            "type": "drive",
            "role": role,
            "sequence": self.sequence,
            "time": clock_ms() - ago_ms,
            "speed_mps": 0.2,
            "turn_rate_radps": 0.1,
        }
        await self.say({**message, **more})
        return self.sequence


@asynccontextmanager
async def hand(served: Any, name: str | None = None) -> AsyncIterator[Hand]:
    path = "/api/drive" if name is None else f"/api/drive?name={name}"
    async with served.socket(path) as socket:
        page = Hand(socket)
        listening = asyncio.create_task(page.listen())
        try:
            await page.next("link", quality="good")
            yield page
        finally:
            listening.cancel()
            await asyncio.gather(listening, return_exceptions=True)


def robot(role: Any, port: str) -> RobotPort:
    return RobotPort(role, f"socket://127.0.0.1:{port}", "amigo-sh", f"the {role}")


@pytest.fixture
def world(peer: Any) -> None:
    """A simulated world with both robots."""
    peer.world = "simulated:lab/1"
    peer.robots = (robot("observer", "5001"), robot("obstacle", "5002"))


pytestmark = pytest.mark.usefixtures("world")


async def arm(served: Any, lease: str | None, role: str = "observer") -> int:
    answer = await served.http.post(f"/api/robots/{role}/arm", json={"lease": lease})
    return int(answer.status_code)


async def test_an_operator_takes_control_arms_drives_and_leaves(
    served: Any, drive: Any, eventually: Any
) -> None:
    await eventually(lambda: len(drive.robots) == 2)
    async with hand(served, "Anna") as anna:
        assert (await anna.next("operator"))["name"] == "Anna"
        await anna.drive()
        assert "take control of the observer first" in (await anna.next("refused"))["sentence"]
        lease = await anna.take()
        assert (lease["state"], lease["holder"]) == ("yours", "Anna")
        # Taking it twice gives the same lease.
        assert (await anna.take())["lease"] == lease["lease"]
        assert len(drive.of(TakeLease)) == 1
        sequence = await anna.drive()
        sent = await anna.next("sent", sequence=sequence)
        assert (sent["speed_mps"], sent["limited_by"]) == (0.0, "not armed")
        assert await arm(served, lease["lease"]) == 200
        sequence = await anna.drive(speed_mps=0.9)
        sent = await anna.next("sent", sequence=sequence)
        assert (sent["speed_mps"], sent["turn_rate_radps"]) == (0.3, 0.1)
        assert 0 <= sent["age_ms"] < 250
        anna.sequence += 1
        present = {"type": "present", "role": "observer", "sequence": anna.sequence}
        await anna.say({**present, "time": clock_ms()})
        await eventually(lambda: drive.of(Presence))
        asked = drive.of(DriveCommand)[-1]
        assert asked.lease == lease["lease"]
        assert asked.issued <= time.monotonic()
        told = (await served.http.get("/api/robots")).json()["robots"]["observer"]
        assert (told["operator"], told["state"]) == ("Anna", "armed")
    await eventually(lambda: drive.of(ReleaseLease))
    assert drive.of(ReleaseLease)[-1].lease == lease["lease"]
    assert not drive.leases


async def test_one_operator_drives_and_takeover_is_explicit(
    served: Any, drive: Any, eventually: Any
) -> None:
    await eventually(lambda: len(drive.robots) == 2)
    async with hand(served, "Anna") as anna, hand(served) as other:
        mine = (await anna.take())["lease"]
        refused = await other.take()
        assert (refused["state"], refused["holder"]) == ("refused", "Anna")
        assert "Anna drives the observer" in refused["sentence"]
        # Over REST as well: without the lease it cannot be armed.
        assert await arm(served, None) == 409
        assert await arm(served, "another") == 409
        await other.drive()
        assert (await other.next("refused"))["sequence"] == other.sequence
        assert not drive.of(DriveCommand)
        assert await arm(served, mine) == 200
        taken = await other.take(takeover=True)
        assert taken["state"] == "yours"
        lost = await anna.next("lease", state="lost")
        assert lost["holder"] == taken["holder"]
        assert "took control of the observer" in lost["sentence"]
        assert "observer" not in drive.armed
        await anna.drive()
        assert "take control of the observer first" in (await anna.next("refused"))["sentence"]
        # The other role is free throughout.
        assert (await anna.take("obstacle"))["state"] == "yours"
        await other.say({"type": "release", "role": "observer"})
        await eventually(lambda: "observer" not in drive.leases)
        assert (await anna.take())["state"] == "yours"


async def test_names_are_made_unique_and_readable(served: Any) -> None:
    async with hand(served, "Anna") as first, hand(served, "Anna") as second:
        names = [(await each.next("operator"))["name"] for each in (first, second)]
        assert names[0] == "Anna"
        assert names[1].startswith("Anna (")
    async with hand(served, "%00%0a") as third, hand(served, 100 * "x") as fourth:
        assert (await third.next("operator"))["name"] == "operator 3"
        assert (await fourth.next("operator"))["name"] == 40 * "x"


async def test_old_or_repeated_commands_are_refused(
    served: Any, drive: Any, eventually: Any
) -> None:
    await eventually(lambda: len(drive.robots) == 2)
    async with hand(served) as page:
        lease = (await page.take())["lease"]
        assert await arm(served, lease) == 200
        late = await page.drive(ago_ms=400)
        refused = await page.next("refused", sequence=late)
        assert refused["sentence"] == "stopped: connection too slow"
        slow = await page.next("link", quality="slow")
        assert slow["sentence"] == "stopped: connection too slow"
        assert slow["delay_ms"] > 250
        good = await page.drive()
        await page.next("sent", sequence=good)
        for sequence in (good, good - 1, 0):
            await page.drive(sequence=sequence)
            refused = await page.next("refused", sequence=sequence)
            assert "sequence must be greater than" in refused["sentence"]
        # A timestamp in the future does not make a command fresh.
        await page.drive(ago_ms=-5000, sequence=good + 50)
        assert "delay is unknown" in (await page.next("refused", sequence=good + 50))["sentence"]
        assert [command.sequence for command in drive.of(DriveCommand)] == [good]


async def test_commands_are_refused_before_the_link_is_measured(served: Any, drive: Any) -> None:
    async with served.socket("/api/drive") as socket:
        page = Hand(socket)
        await page.say({"type": "take", "role": "observer"})
        await page.drive()
        while (message := json.loads(await socket.recv()))["type"] != "refused":
            pass
        assert "delay is unknown" in message["sentence"] or "take" in message["sentence"]
        assert not drive.of(DriveCommand)


async def test_non_numeric_values_are_refused_and_the_socket_stays_open(
    served: Any, drive: Any
) -> None:
    async with hand(served) as page:
        await page.take()
        fields = {"role": "observer", "sequence": 1, "time": clock_ms()}
        body = {"type": "drive", **fields, "speed_mps": 0.1, "turn_rate_radps": 0}
        for key in ("time", "speed_mps", "turn_rate_radps", "sequence"):
            for value in ("NaN", "Infinity", "1e999", "true", "null", '"0.1"'):
                text = json.dumps({**body, key: "HERE"}).replace('"HERE"', value)
                await page.say(text)
                assert key in (await page.next("refused"))["sentence"]
            await page.say({name: value for name, value in body.items() if name != key})
            assert key in (await page.next("refused"))["sentence"]
        assert not drive.of(DriveCommand)
        await page.next("sent", sequence=await page.drive())


async def test_garbage_closes_with_1007_and_releases_the_lease(
    served: Any, drive: Any, eventually: Any
) -> None:
    for garbage in ("hello", "[1]", '{"type": "fly"}', "[" * 900, b"\x00\xff"):
        async with hand(served) as page:
            assert (await page.take())["state"] == "yours"
            await page.socket.send(garbage)
            await eventually(lambda: page.socket.close_code is not None)
            assert page.socket.close_code == 1007
        await eventually(lambda: not drive.leases)


async def test_anyone_can_stop_immediately(served: Any, drive: Any, eventually: Any) -> None:
    await eventually(lambda: len(drive.robots) == 2)
    async with hand(served, "Anna") as anna, hand(served, "Bert") as bert:
        lease = (await anna.take())["lease"]
        assert await arm(served, lease) == 200
        await bert.say({"type": "stop"})
        await eventually(lambda: drive.stopped)
        assert drive.of(StopRobots)[0].by == "Bert"
        assert not drive.armed
        # Also while the drive process answers no commands.
        drive.hangs = True
        for _ in range(8):
            await anna.drive()
        await anna.say({"type": "stop"})
        await eventually(lambda: len(drive.of(StopRobots)) == 2)
        told = await anna.next("refused", sequence=None)
        assert "use the robots' own stop switch" in told["sentence"]
        drive.hangs = False


async def test_losing_the_drive_process_ends_all_leases(
    served: Any, drive: Any, eventually: Any
) -> None:
    async with hand(served) as page:
        await page.take()
        drive.lose("the drive process ended with exit code 1")
        lost = await page.next("lease", state="lost")
        assert "exit code 1" in lost["sentence"]
        assert (await page.take())["state"] == "refused"
        drive.start_process()
        await eventually(lambda: len(drive.robots) == 2)
        assert (await page.take())["state"] == "yours"
        # A lease that the process does not know is lost.
        drive.leases.clear()
        for _ in range(2):
            drive.tell()
        assert (await page.next("lease", state="lost"))["holder"] is None


async def test_excess_commands_are_refused_and_not_queued(served: Any, drive: Any) -> None:
    async with hand(served) as page:
        await page.take()
        drive.hangs = True
        sequences = [await page.drive() for _ in range(12)]
        refused = await page.next("refused", sequence=sequences[-1])
        assert "is overloaded" in refused["sentence"]
        await page.next("refused", sequence=sequences[0])
        drive.hangs = False
        await page.next("sent", sequence=await page.drive())
        passed_on = [command.sequence for command in drive.of(DriveCommand)]
        assert passed_on == [*sequences[:8], sequences[-1] + 1]


async def test_a_client_that_stops_reading_is_dropped(
    served: Any, drive: Any, eventually: Any
) -> None:
    async with served.socket("/api/drive") as socket:
        page = Hand(socket)
        await page.say({"type": "take", "role": "observer"})
        await eventually(lambda: drive.leases)
        socket.transport.pause_reading()
        with contextlib.suppress(ConnectionClosed):
            # The answers must exceed the socket buffers of both ends.
            async with asyncio.timeout(20):
                while drive.leases:
                    await page.say('{"type": "present", "role": "observer"}')
        assert not drive.leases
        socket.transport.abort()


# --- a stalled loop --------------------------------------------------------------------------


class Elsewhere(threading.Thread):
    """A page that keeps sending commands, whatever the server's event loop does.

    Attributes:
        speed_mps: speed of its commands; None: it is only present.
    """

    def __init__(self, port: int, token: str, role: str = "observer") -> None:
        super().__init__(name="a page")
        self.role = role
        self.speed_mps: float | None = 0.2
        self._url = f"ws://127.0.0.1:{port}/api/drive"
        self._headers = {"Authorization": f"Bearer {token}"}
        self.started = threading.Event()
        self.done = threading.Event()
        self.given: dict[int, float] = {}
        self.heard: list[dict[str, Any]] = []

    def run(self) -> None:
        with connect(
            self._url, additional_headers=self._headers, compression=None, proxy=None
        ) as socket:
            socket.send(json.dumps({"type": "take", "role": self.role}))
            sequence, due = 0, time.monotonic() + 0.6
            while not self.done.is_set():
                for message in self._messages(socket, due):
                    if message["type"] == "ping":
                        pong = {"type": "pong", "id": message["id"], "time": clock_ms()}
                        socket.send(json.dumps(pong))
                    self.heard.append(message)
                due, sequence = due + 0.1, sequence + 1
                self.given[sequence] = time.monotonic()
                command = {"role": self.role, "sequence": sequence, "time": clock_ms()}
                moves = {"speed_mps": self.speed_mps, "turn_rate_radps": 0.0}
                if self.speed_mps is None:
                    socket.send(json.dumps({"type": "present", **command}))
                else:
                    socket.send(json.dumps({"type": "drive", **command, **moves}))
                if sequence > 5:
                    self.started.set()

    @property
    def lease(self) -> str | None:
        """Return its lease, None until it has one."""
        return next((m["lease"] for m in self.heard if m["type"] == "lease"), None)

    @staticmethod
    def _messages(socket: Any, until: float) -> Iterator[dict[str, Any]]:
        while (left := until - time.monotonic()) > 0:
            try:
                yield json.loads(socket.recv(timeout=left))
            except TimeoutError:
                return


async def test_commands_queued_during_a_stall_are_refused(
    served: Any, drive: Any, eventually: Any, token: str
) -> None:
    """Two seconds of commands wait in the kernel; their age is known when they are read."""

    page = Elsewhere(served.port, token)
    page.start()
    try:
        await eventually(page.started.is_set)
        stood_from = time.monotonic()
        time.sleep(2.0)
        stood_until = time.monotonic()
        await asyncio.sleep(1.0)
    finally:
        page.done.set()
        await asyncio.to_thread(page.join)
    refused = {m["sequence"] for m in page.heard if m["type"] == "refused"}
    waited = [
        sequence
        for sequence, given in page.given.items()
        if stood_from + 0.05 < given < stood_until - 0.25
    ]
    assert len(waited) > 10
    assert set(waited) <= refused
    for command in drive.of(DriveCommand):
        given = page.given[command.sequence]
        # Never rated fresher than it is, within the uncertainty of the clocks.
        assert command.issued <= given + 0.02
    # The link recovers by itself.
    assert max(c.sequence for c in drive.of(DriveCommand)) > max(waited)


async def test_the_connection_is_not_compressed(served: Any) -> None:
    async with served.socket("/api/drive") as socket:
        assert "sec-websocket-extensions" not in socket.response.headers
