"""The paper's method step by step, on one frozen pair of frames."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query, Request, Response

from app.contract.steps import MethodSteps, StepFormat
from app.contract.values import LONGEST_SPEC
from app.http.api.common import TheServer
from app.http.api.refusals import refusals
from app.http.api.values import LAST_FRAME, MOST_CHANGES, Name
from app.http.cancel_on_disconnect import while_there
from app.http.gate.headers import REPORT_POLICY
from app.server.errors import FieldError
from app.server.steps.manager import PairChoice
from observer.parameters import typed_value

router = APIRouter(prefix="/steps", tags=["steps"])

# Before the name of a parameter in an address.
_PREFIX = "p."
_KINDS: dict[StepFormat, str] = {
    "png": "image/png",
    "svg": "image/svg+xml",
    "pdf": "application/pdf",
    "csv": "text/csv; charset=utf-8",
}


def _choice(
    request: Request,
    source: Annotated[
        str | None,
        Query(
            min_length=1,
            max_length=LONGEST_SPEC,
            description="simulated:SCENARIO, run:ID or a source that was opened before; default: "
            "the open one.",
        ),
    ] = None,
    frame: Annotated[
        int | None,
        Query(
            ge=0,
            le=LAST_FRAME,
            description="Position of the image at t+dt, from 0; default: one worth looking at.",
        ),
    ] = None,
    preset: Annotated[Name, Query(description="A preset with a planar method.")] = "paper",
) -> PairChoice:
    """A parameter is given as ``p.NAME=VALUE``, as in ``p.flow.residual_threshold_px=2``."""
    changes = {
        name.removeprefix(_PREFIX): typed_value(value)
        for name, value in request.query_params.multi_items()
        if name.startswith(_PREFIX)
    }
    if len(changes) > MOST_CHANGES:
        raise FieldError(("query",), f"at most {MOST_CHANGES} parameters can be changed")
    return PairChoice(source, frame, preset, changes)


Choice = Annotated[PairChoice, Depends(_choice)]


@router.get(
    "", summary="The nine steps of the method on one pair", responses=refusals(409, 422, 503)
)
async def get_steps(choice: Choice, server: TheServer, request: Request) -> MethodSteps:
    """Title, formula and numbers of each step; ``p.NAME=VALUE`` changes any parameter.

    The open source and the current parameters do not change.
    """
    return await while_there(request, server.steps.steps(choice))


@router.get(
    "/{number}.{format}",
    summary="Picture or data of one step",
    response_class=Response,
    responses={
        200: {"content": {kind.partition(";")[0]: {} for kind in _KINDS.values()}},
        **refusals(409, 422, 503),
    },
)
async def get_step(
    number: Annotated[int, Path(ge=1, le=9)],
    format: StepFormat,
    choice: Choice,
    server: TheServer,
    request: Request,
    labelled: Annotated[
        bool, Query(description="With title, formula and explanation, as a self-contained picture.")
    ] = True,
    dark: Annotated[bool, Query(description="SVG for a dark background.")] = False,
) -> Response:
    """The pair is chosen as for the list of steps."""
    work = server.steps.file(choice, number, format, dark=dark, labelled=labelled)
    content = await while_there(request, work)
    headers = {"content-disposition": f'inline; filename="step-{number}.{format}"'}
    if format == "svg":
        # A drawing uses style attributes; it has no script and loads nothing.
        headers["content-security-policy"] = REPORT_POLICY
    return Response(content, media_type=_KINDS[format], headers=headers)
