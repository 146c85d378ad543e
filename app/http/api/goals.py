"""Goal of the observer: it drives there by itself, around moving obstacles."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter
from fastapi.responses import Response
from pydantic import Field

from app.contract.drive import FARTHEST_GOAL_M, StartGoal, StopGoal
from app.contract.robots import GoalNow, RobotsNow
from app.http.api.common import TheServer
from app.http.api.refusals import refusals
from app.http.api.values import Finite, Identifier, In
from app.http.errors import answer
from observer.navigation.parameters import AllParameters

router = APIRouter(prefix="/goal", tags=["robots"])
_RISK = AllParameters.declaration("navigation.risk_per_metre")


class GoalChoice(In):
    ahead_m: Annotated[Finite, Field(ge=-FARTHEST_GOAL_M, le=FARTHEST_GOAL_M)] = Field(
        description="Distance ahead of the robot's current pose, m."
    )
    left_m: Annotated[Finite, Field(ge=-FARTHEST_GOAL_M, le=FARTHEST_GOAL_M)] = Field(
        0.0, description="Distance to its left, m."
    )
    risk_per_metre: Annotated[Finite, Field(ge=_RISK["minimum"], le=_RISK["maximum"])] | None = (
        Field(
            None,
            description="Accepted probability of a contact with tracked obstacles per metre "
            "driven; default: the parameter navigation.risk_per_metre.",
        )
    )
    lease: Identifier = Field(description="Lease of the observer, which must be armed.")


@router.post(
    "",
    responses={200: {"model": GoalNow}, **refusals(409, 422, 503)},
    summary="Send the observer to a goal",
)
async def start_goal(wanted: GoalChoice, server: TheServer) -> Response:
    """Runs while its operator stays present on the drive socket; replaces the previous goal.

    This is an aid for attentive operators, tested in simulation only; the guard limits what the
    robot drives.
    """
    risk = wanted.risk_per_metre
    if risk is None:
        risk = server.parameters.current.values.navigation.risk_per_metre
    command = StartGoal(wanted.lease, wanted.ahead_m, wanted.left_m, risk)
    goal = await server.driving.ask(command)
    return answer(goal)


@router.delete(
    "",
    responses={200: {"model": RobotsNow}, **refusals(409, 503)},
    summary="Cancel the goal",
)
async def stop_goal(server: TheServer) -> Response:
    """The robot stops and stays armed."""
    await server.driving.ask(StopGoal())
    return answer(server.driving.facts())
