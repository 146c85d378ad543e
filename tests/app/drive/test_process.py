"""The real drive process with emulated robots: how soon the first zero reaches their ports.

Each test prints its worst value. DRIVE_TRIALS sets how often each fault is tried.
"""

from __future__ import annotations

import os
import socket
import sys
import time

from app.contract.drive import (
    WHEELS_NAME,
    ConnectRobot,
    DisarmRobot,
    DisconnectRobot,
    ReleaseLease,
    ResetStop,
    StopRobots,
)
from app.runtime.latest import LatestReader

from .driving import PROMISED_S, SPEED_MPS, Drive, Eyes, Robots, report, zero_after

TRIALS = int(os.environ.get("DRIVE_TRIALS", "2"))


# --- while the process lives --------------------------------------------------------------------


def test_expiry_lost_lease_stop_lost_sight_and_silence_send_zero_in_time(
    drive: Drive, robots: Robots, eyes: Eyes
) -> None:
    drive.connect(robots)
    worst = dict.fromkeys(("expiry", "lease", "stop", "sight", "silence"), 0.0)
    for _ in range(TRIALS):
        for what in worst:
            for role in robots:
                drive.arm(role)
            moment = drive.speed_up(robots)
            standing = ["observer", "obstacle"]
            if what != "expiry":
                moment = time.monotonic()
            if what == "lease":
                for role in robots:
                    drive.value(ReleaseLease(role, drive.leases[role]))  # type: ignore[arg-type]
            elif what == "stop":
                drive.value(StopRobots("a test"))
            elif what == "sight":
                eyes.open, standing = False, ["observer"]
                time.sleep(0.04)
                moment = eyes.last
                while time.monotonic() < moment + 0.4:
                    drive.command("observer", SPEED_MPS)
                    drive.command("obstacle", SPEED_MPS)
                    time.sleep(0.02)
                eyes.open = True
            elif what == "silence":
                faults, standing = robots["obstacle"].robot.faults, ["obstacle"]
                faults.silent = True
                while time.monotonic() < moment + 0.4:
                    drive.command("observer", SPEED_MPS)
                    drive.command("obstacle", SPEED_MPS)
                    time.sleep(0.02)
                faults.silent = False
            for role in standing:
                worst[what] = max(worst[what], zero_after(robots[role], moment))
            if what == "stop":
                drive.value(ResetStop("a test"))
            for role in robots:
                drive.value(DisarmRobot(role))  # type: ignore[arg-type]
    for what, value in worst.items():
        report(what, value)
        assert value <= PROMISED_S
    assert worst["expiry"] >= 0.22, "a command must count for its time"
    facts = drive.facts["loop"]
    sys.stdout.write(f"loop: {facts}\n")


def test_a_hung_port_never_delays_the_other(
    drive: Drive, robots: Robots, slots: dict[str, int]
) -> None:
    drive.connect(robots)
    for role in robots:
        drive.arm(role)
    drive.speed_up(robots)
    # Its socket is no longer read, and it sends nothing: it hangs.
    robots["observer"].robot.faults.deaf = robots["observer"].robot.faults.silent = True

    def drives_on() -> None:
        started = time.monotonic()
        if drive.hold("obstacle", 2.0):
            assert all(
                not each.is_standstill for each in robots["obstacle"].robot.log.since(started)
            )

    drives_on()
    assert drive.state("observer") != "moving"
    # This port accepts no connection and answers nothing.
    with socket.create_server(("127.0.0.1", 0), backlog=1) as hanging:
        port = f"socket://127.0.0.1:{hanging.getsockname()[1]}"
        drive.value(ConnectRobot("observer", port, None, "real"))
        drives_on()
        drive.value(DisconnectRobot("observer"))
    reader = LatestReader(slots[WHEELS_NAME])
    latest = reader.read()
    reader.close()
    assert latest is not None
    assert len(latest.header["obstacle"]) >= 5
    assert latest.header["observer"] == []
    sys.stdout.write(f"\nloop: {drive.facts['loop']}\n")
