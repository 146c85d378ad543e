"""Manual driving over the socket: operators, leases and stops."""

from __future__ import annotations

import time
from typing import Any

import pytest

from app.contract.drive import DriveCommand, Presence, ReleaseLease, StopRobots, TakeLease

from .pages import arm, clock_ms, hand

pytestmark = pytest.mark.usefixtures("world")


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


async def test_the_connection_is_not_compressed(served: Any) -> None:
    async with served.socket("/api/drive") as socket:
        assert "sec-websocket-extensions" not in socket.response.headers
