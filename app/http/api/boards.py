"""Boards to print, in true scale."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Path, Query, Response

from app.http.api.common import attachment
from app.http.api.refusals import refusals
from app.http.api.values import Corners, SquareMm
from app.server import FieldError
from app.server.calibrating.session import board_of
from observer.calibration.boards.board import A4_COLUMNS, A4_ROWS, A4_SQUARE_MM, BoardKind
from observer.calibration.boards.printing import Paper, board_pdf, board_svg
from observer.errors import CalibrationError

router = APIRouter(tags=["calibrating"])

_KINDS = {"svg": "image/svg+xml", "pdf": "application/pdf"}


@router.get(
    "/boards/{kind}.{format}",
    summary="Printable calibration board with a bar to measure",
    response_class=Response,
    responses={
        200: {"content": {kind: {} for kind in _KINDS.values()}},
        **refusals(422),
    },
)
def get_board(
    kind: BoardKind,
    format: Annotated[Literal["svg", "pdf"], Path()],
    columns: Annotated[Corners, Query(description="Inner corners across.")] = A4_COLUMNS,
    rows: Annotated[Corners, Query()] = A4_ROWS,
    square_mm: Annotated[SquareMm, Query()] = A4_SQUARE_MM,
    paper: Paper = "A4",
) -> Response:
    """Print it at 100 %.

    A board that does not fit the paper is refused, and the sentence says what would fit.
    """
    board = board_of(kind, columns, rows, square_mm)
    try:
        content = board_svg(board, paper) if format == "svg" else board_pdf(board, paper)
    except CalibrationError as error:
        raise FieldError(("query", "square_mm"), str(error)) from error
    name = f"board-{kind}-{columns}x{rows}-{square_mm:g}mm.{format}"
    return attachment(content, name, _KINDS[format])
