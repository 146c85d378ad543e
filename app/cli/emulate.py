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
            min=0, max=65535, help="TCP port of this machine; 0, as without it: a free one."
        ),
    ] = None,
    pty: Annotated[bool, typer.Option("--pty", help="A pseudo terminal instead.")] = False,
    watchdog: Annotated[
        float,
        typer.Option(min=0.1, max=60, help="Seconds without a command after which it stops."),
    ] = WATCHDOG_S,
) -> None:
    """Emulate a robot on an empty floor until Ctrl-C, and print the port to connect it by."""
    if pty and tcp is not None:
        raise InputError("a robot has one port: name --tcp or --pty, not both")
    robot = EmulatedRobot(model, now=time.monotonic(), watchdog_s=watchdog, seed=0)
    with serve_pty(robot) if pty else serve_tcp(robot, tcp or 0) as serving:
        typer.echo(serving.port)
        typer.echo(f"an emulated {robot.spec.title} waits at this port; Ctrl-C ends it", err=True)
        try:
            threading.Event().wait()
        except KeyboardInterrupt:
            typer.echo(f"it took {robot.log.count} commands", err=True)
