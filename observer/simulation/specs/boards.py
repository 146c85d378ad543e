"""A calibration board that a person holds before the cameras."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from observer.calibration.boards.board import Board, BoardKind
from observer.errors import CalibrationError
from observer.simulation.specs.base import Spec

_Offset = Annotated[float, Field(ge=-10, le=10)]
_Depth = Annotated[float, Field(ge=0.1, le=10)]
_Angle = Annotated[float, Field(ge=-180, le=180)]


class BoardPoseSpec(Spec):
    """Pose of the board relative to the left camera's optical frame at time 0.

    Attributes:
        centre: x right, y down, z forward of the board's centre, metres.
        turn_deg: turns about the camera's x, y and z axes through the board's centre, in this
            order; with none the board faces the camera upright.
    """

    centre: tuple[_Offset, _Offset, _Depth]
    turn_deg: tuple[_Angle, _Angle, _Angle] = (0.0, 0.0, 0.0)


class BoardSpec(Spec):
    """The board, see ``observer.calibration.boards.board.Board``, and its motion.

    Attributes:
        columns, rows: numbers of inner corners.
        hold_s: duration of each pose. move_s: duration of the move to the next one.
        tremor_mm: largest tremor of the hands along each axis.
        poses: visited in turn and repeated forever.
    """

    pattern: BoardKind = "chessboard"
    columns: int = 9
    rows: int = 6
    square_mm: float = 25.0
    hold_s: float = Field(0.8, gt=0, le=60)
    move_s: float = Field(0.7, gt=0, le=60)
    tremor_mm: float = Field(0.0, ge=0, le=10)
    poses: tuple[BoardPoseSpec, ...] = Field(min_length=1, max_length=200)

    @property
    def board(self) -> Board:
        return Board(self.pattern, self.columns, self.rows, self.square_mm / 1000)

    @model_validator(mode="after")
    def _is_a_board(self) -> BoardSpec:
        try:
            _ = self.board
        except CalibrationError as error:
            raise ValueError(str(error)) from None
        return self
