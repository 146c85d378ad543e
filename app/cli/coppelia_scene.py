"""``dynamic-observer coppelia-scene``: build the paper's scene in a running CoppeliaSim."""

from __future__ import annotations

from typing import Annotated

import typer


def coppelia_scene(
    address: Annotated[
        str, typer.Argument(metavar="[HOST:PORT]", help="Address of the simulator.")
    ] = "127.0.0.1:23000",
) -> None:
    """Build the paper's scene in CoppeliaSim.

    Two P3-DX, stereo cameras on one, walls and textured boxes.
    """
    from observer.coppeliasim.address import parse_address
    from observer.coppeliasim.scene import build_scene

    simulator = parse_address(address)
    scene = build_scene(simulator)
    observer, obstacle = scene.robots
    left, right = scene.cameras
    typer.echo(f"observer {observer} with the cameras {left} and {right}, obstacle {obstacle}")
    typer.echo(f"next: dynamic-observer serve {simulator.world}")
