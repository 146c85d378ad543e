"""Robots: connecting, arming, stopping. What moves them comes over ``/api/drive``."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Body, Request
from fastapi.responses import Response

from app.drive.messages import ArmRobot, DisarmRobot
from app.http.api.common import TheStation, who
from app.http.api.programmes import programme_command
from app.http.api.refusals import refusals
from app.http.api.robot_models import (
    Arming,
    PortChoice,
    ProgrammeStart,
    RobotNow,
    RobotsNow,
    RoleName,
)
from app.http.errors import SafeJSON
from app.server import NotThere, Station

router = APIRouter(prefix="/robots", tags=["robots"])

# Answers are what the drive process says; they are described, not checked again.
_ROBOTS: dict[int | str, dict[str, Any]] = {200: {"model": RobotsNow}}


def _facts(station: Station) -> Response:
    return SafeJSON(station.driving.facts())


@router.get("", response_model=None, responses=_ROBOTS, summary="How the robots are")
async def get_robots(station: TheStation) -> Response:
    return _facts(station)


@router.post(
    "/stop",
    response_model=None,
    responses={**_ROBOTS, **refusals(503)},
    summary="Stop all robots",
)
async def stop_robots(request: Request, station: TheStation) -> Response:
    """A software stop, no emergency stop (ISO 13850). It holds until it is reset.

    Anyone signed in may stop; it waits for no run, lease or other request.
    """
    await station.driving.stop_robots(who(request))
    return _facts(station)


@router.post(
    "/reset",
    response_model=None,
    responses={**_ROBOTS, **refusals(409, 503)},
    summary="Undo the stop",
)
async def reset_stop(request: Request, station: TheStation) -> Response:
    """Faults whose cause is over are forgotten as well; all robots stay disarmed."""
    await station.driving.reset(who(request))
    return _facts(station)


@router.post(
    "/programme",
    response_model=None,
    responses={**_ROBOTS, **refusals(404, 409, 415, 422, 503)},
    summary="Drive a programme",
)
async def start_programme(wanted: ProgrammeStart, station: TheStation) -> Response:
    """As long as the operators of its robots stay present on their drive sockets."""
    await station.driving.start_programme(await programme_command(station, wanted))
    return _facts(station)


@router.delete(
    "/programme",
    response_model=None,
    responses={**_ROBOTS, **refusals(409, 503)},
    summary="End the programme",
)
async def stop_programme(station: TheStation) -> Response:
    """At zero; the robots stay armed."""
    await station.driving.stop_programme()
    return _facts(station)


@router.post(
    "/{role}/arm",
    response_model=None,
    responses={200: {"model": RobotNow}, **refusals(404, 409, 415, 422, 503)},
    summary="Switch a robot's motors on",
)
async def arm_robot(
    role: RoleName, station: TheStation, arming: Annotated[Arming | None, Body()] = None
) -> Response:
    """At zero velocity. Nothing else ever switches them on."""
    await station.driving.ask(ArmRobot(role, None if arming is None else arming.lease))
    return _robot(station, role)


@router.post(
    "/{role}/disarm",
    response_model=None,
    responses={200: {"model": RobotNow}, **refusals(404, 409, 422, 503)},
    summary="Switch a robot's motors off",
)
async def disarm_robot(role: RoleName, station: TheStation) -> Response:
    """Anyone signed in may."""
    await station.driving.ask(DisarmRobot(role))
    return _robot(station, role)


@router.put(
    "/{role}/port",
    response_model=None,
    responses={**_ROBOTS, **refusals(415, 422, 503, 507)},
    summary="Reach a real robot by a port",
)
async def put_port(role: RoleName, choice: PortChoice, station: TheStation) -> Response:
    """It is kept in rig.yaml, and connected as long as live cameras are open."""
    await station.change_rig(lambda: station.rig.with_port(role, choice.port, choice.model))
    return _facts(station)


@router.delete(
    "/{role}/port",
    response_model=None,
    responses={**_ROBOTS, **refusals(422, 503, 507)},
    summary="Forget a robot's port",
)
async def delete_port(role: RoleName, station: TheStation) -> Response:
    await station.change_rig(lambda: station.rig.without_port(role))
    return _facts(station)


def _robot(station: Station, role: RoleName) -> Response:
    robot = station.driving.robot(role)
    if robot is None:
        raise NotThere(f"no {role} is connected")
    return SafeJSON(robot)
