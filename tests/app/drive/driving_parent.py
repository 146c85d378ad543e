"""A stand-in for the web process: connects, arms and drives robots until it is ended.

Arguments: the descriptors of the shared slots in order, then ROLE=PORT for each robot.
Prints the time of each round of commands, once all robots drive.
"""

from __future__ import annotations

import asyncio
import sys
import time
from contextlib import suppress

from app.contract.drive import (
    SHARED_NAMES,
    ArmRobot,
    ConnectRobot,
    DriveCommand,
    DriveState,
    SetGuard,
    TakeLease,
)
from app.drive.driven_role import RELEASE_FIRST
from app.drive.supervisor import DriveSupervisor
from app.runtime.errors import ProcessRefused

SPEED_MPS = 0.3


async def main(slots: dict[str, int], ports: dict[str, str]) -> None:
    supervisor = DriveSupervisor(slots)
    newest: list[DriveState] = []

    def hear(event: object) -> None:
        if isinstance(event, DriveState):
            newest[:] = [event]

    supervisor.subscribe(hear)
    await supervisor.start()
    leases = {}
    for role, port in ports.items():
        await supervisor.request(ConnectRobot(role, port, None, "real"), 10)  # type: ignore[arg-type]
        leases[role] = await supervisor.request(TakeLease(role, "Ann"), 10)  # type: ignore[arg-type]

    def all_in(*states: str) -> bool:
        return bool(newest) and all(
            getattr(newest[0].facts.robots[role], "state", None) in states  # type: ignore[index]
            for role in ports
        )

    while not all_in("disarmed"):
        await asyncio.sleep(0.02)
    for role in ports:
        await supervisor.request(ArmRobot(role, leases[role]), 10)  # type: ignore[arg-type]
    await supervisor.request(SetGuard({"guard.acceleration_mps2": 3.0}), 10)
    number, started, told = 0, time.monotonic(), False
    lets_go = False
    while True:
        number += 1
        issued = time.monotonic()
        if issued - started > 0.2:
            told = True
            # Printed first: a parent stopped in between must not have sent an unprinted command.
            sys.stdout.write(f"{issued!r}\n")
            sys.stdout.flush()
        wants_release = False
        for role in ports:
            speed = 0.0 if lets_go else SPEED_MPS
            command = DriveCommand(role, leases[role], number, issued, speed, 0.0)  # type: ignore[arg-type]
            try:
                answer = await supervisor.request(command, 10)
            except ProcessRefused:
                # This process stalled meanwhile; it goes on as if a key were still held.
                continue
            if answer.speed_mps < SPEED_MPS - 0.01:
                started = time.monotonic()
                limited = answer.limited_by or ""
                wants_release = wants_release or RELEASE_FIRST in limited
                if "not armed" in limited and not told:
                    with suppress(ProcessRefused):
                        await supervisor.request(ArmRobot(role, leases[role]), 10)  # type: ignore[arg-type]
        # If a stall stops it before it drives, let go of the key; after that the key stays held.
        lets_go = wants_release and not told
        await asyncio.sleep(0.1)


if __name__ == "__main__":
    slots = {name: int(fd) for name, fd in zip(SHARED_NAMES, sys.argv[1:4], strict=True)}
    asyncio.run(
        main(
            slots,
            dict(text.split("=", 1) for text in sys.argv[4:]),
        )
    )
