"""Robots: connecting, arming, stopping. Drive commands come over ``/api/drive``."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Body, Request
from fastapi.responses import Response
from pydantic import Field

from app.contract.drive import ArmRobot, DisarmRobot, StopProgramme
from app.contract.robots import RobotNow, RobotsNow
from app.http.api.common import TheServer, who
from app.http.api.programmes import ProgrammeStart, programme_command
from app.http.api.refusals import refusals
from app.http.api.values import Identifier, In
from app.http.errors import answer
from app.server import NotThere, Server
from observer.rig.rig import RobotModel, Role

router = APIRouter(prefix="/robots", tags=["robots"])

# Answers come from the drive process; they are documented here, but not validated again.
_ROBOTS: dict[int | str, dict[str, Any]] = {200: {"model": RobotsNow}}


class PortChoice(In):
    port: Annotated[str, Field(strict=True, min_length=1, max_length=200)] = Field(
        description="As in /dev/ttyUSB0, a path below /dev/serial/by-id, socket://HOST:8101, "
        "coppeliasim:HOST:PORT/OBJECT, external:HOST:PORT?key=KEY. A port given as it is "
        "shown, without its key, keeps the key."
    )
    model: RobotModel | None = Field(None, description="null: as reported by the robot.")


class Arming(In):
    lease: Identifier | None = Field(
        None, description="Lease of the operator in control; null if nobody has control."
    )


def _facts(server: Server) -> Response:
    return answer(server.driving.facts())


@router.get("", responses=_ROBOTS, summary="State of the robots")
async def get_robots(server: TheServer) -> Response:
    return _facts(server)


@router.post("/stop", responses={**_ROBOTS, **refusals(503)}, summary="Stop all robots")
async def stop_robots(request: Request, server: TheServer) -> Response:
    """A software stop, not a substitute for an emergency stop (ISO 13850).

    It holds until it is reset. Anyone signed in may stop the robots; it waits for no run, lease or
    other request.
    """
    await server.driving.stop_robots(who(request))
    return _facts(server)


@router.post("/reset", responses={**_ROBOTS, **refusals(409, 503)}, summary="Reset the stop")
async def reset_stop(request: Request, server: TheServer) -> Response:
    """Also clears faults whose cause is over; all robots stay disarmed."""
    await server.driving.reset(who(request))
    return _facts(server)


@router.post(
    "/programme",
    responses={**_ROBOTS, **refusals(404, 409, 422, 503)},
    summary="Run a programme",
)
async def start_programme(wanted: ProgrammeStart, server: TheServer) -> Response:
    """Runs while the operators of its robots stay present on their drive sockets."""
    await server.driving.ask(await programme_command(server, wanted))
    return _facts(server)


@router.delete(
    "/programme", responses={**_ROBOTS, **refusals(409, 503)}, summary="Stop the programme"
)
async def stop_programme(server: TheServer) -> Response:
    """Robots stop and stay armed."""
    await server.driving.ask(StopProgramme())
    return _facts(server)


@router.post(
    "/{role}/arm",
    responses={200: {"model": RobotNow}, **refusals(404, 409, 422, 503)},
    summary="Arm a robot (motors on)",
)
async def arm_robot(
    role: Role, server: TheServer, arming: Annotated[Arming | None, Body()] = None
) -> Response:
    """At zero velocity. Nothing else ever switches the motors on."""
    await server.driving.ask(ArmRobot(role, None if arming is None else arming.lease))
    return _robot(server, role)


@router.post(
    "/{role}/disarm",
    responses={200: {"model": RobotNow}, **refusals(404, 409, 422, 503)},
    summary="Disarm a robot (motors off)",
)
async def disarm_robot(role: Role, server: TheServer) -> Response:
    """Anyone signed in may."""
    await server.driving.ask(DisarmRobot(role))
    return _robot(server, role)


@router.put(
    "/{role}/port",
    responses={**_ROBOTS, **refusals(422, 503, 507)},
    summary="Connect a real robot via a port",
)
async def put_port(role: Role, choice: PortChoice, server: TheServer) -> Response:
    """Stored in rig.yaml, and connected while live cameras are open."""
    await server.change_rig(lambda: server.rig.with_port(role, choice.port, choice.model))
    return _facts(server)


@router.delete(
    "/{role}/port",
    responses={**_ROBOTS, **refusals(422, 503, 507)},
    summary="Disconnect a robot's port",
)
async def delete_port(role: Role, server: TheServer) -> Response:
    await server.change_rig(lambda: server.rig.without_port(role))
    return _facts(server)


def _robot(server: Server, role: Role) -> Response:
    robot = server.driving.robot(role)
    if robot is None:
        raise NotThere(f"no {role} is connected")
    return answer(robot)
