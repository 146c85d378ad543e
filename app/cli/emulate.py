"""``dynamic-observer emulate``: emulate a robot to try things without hardware."""

from __future__ import annotations

import threading
import time
from typing import Annotated

import typer

from observer.errors import InputError
from observer.simulation.robots.emulated import EmulatedRobot
from observer.simulation.robots.firmware import WATCHDOG_S
from observer.simulation.robots.serving import serve_pty, serve_tcp


def emulate(
    model: Annotated[str, typer.Argument(help="p3dx-sh, p3dx, amigo-sh or amigo.")],
    tcp: Annotated[
        int | None,
        typer.Option(
            min=0, max=65535, help="TCP port on this computer; 0 or omitted: any free port."
        ),
    ] = None,
    pty: Annotated[bool, typer.Option("--pty", help="Use a pseudo terminal instead.")] = False,
    watchdog: Annotated[
        float,
        typer.Option(
            min=0.1, max=60, help="Seconds without a command after which the robot stops."
        ),
    ] = WATCHDOG_S,
) -> None:
    """Print a port, and emulate a robot on it until Ctrl-C.

    The robot drives on an empty floor.
    """
    if pty and tcp is not None:
        raise InputError("a robot has only one port: give --tcp or --pty, not both")
    robot = EmulatedRobot(model, now=time.monotonic(), watchdog_s=watchdog, seed=0)
    with serve_pty(robot) if pty else serve_tcp(robot, tcp or 0) as serving:
        typer.echo(serving.port)
        typer.echo(
            f"an emulated {robot.spec.title} is listening on this port; press Ctrl-C to stop it",
            err=True,
        )
        try:
            threading.Event().wait()
        except KeyboardInterrupt:
            typer.echo(f"it received {robot.log.count} commands", err=True)
