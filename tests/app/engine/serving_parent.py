"""A stand-in for the server: a supervisor and nothing else, until it is told to stop.

Prints a line with the engines' process ids whenever they change.
"""

from __future__ import annotations

import asyncio
import signal
import sys

import psutil

from app.contract.commands import OpenSource
from app.engine.supervisor import EngineSupervisor
from app.runtime.supervisor_limits import SupervisorLimits


async def main(command: list[str]) -> None:
    supervisor = EngineSupervisor(command=command, limits=SupervisorLimits(standby_delay_s=0.0))
    stopped = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, stopped.set)
    await supervisor.start()
    await supervisor.request(OpenSource("numbers", None, {}, 1))
    while supervisor._standby is None or not supervisor._standby.ready:
        await asyncio.sleep(0.01)
    sys.stdout.write(" ".join(str(child.pid) for child in psutil.Process().children()) + "\n")
    sys.stdout.flush()
    await stopped.wait()
    await supervisor.stop()


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1:]))
