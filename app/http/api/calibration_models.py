"""Calibrations, and the making of them, as OpenAPI shows them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, StrictBool, StrictInt

from app.http.api.values import Finite, In, Name, Spec

# --- calibrating ----------------------------------------------------------------------------

BoardKind = Literal["chessboard", "charuco"]
Corners = Annotated[StrictInt, Field(ge=3, le=30)]
SquareMm = Annotated[Finite, Field(ge=2, le=500)]


class CalibratingStart(In):
    """The board is named by its inner corners, as OpenCV names it."""

    source: Spec | None = Field(None, description="None: what is open.")
    kind: BoardKind = "chessboard"
    columns: Corners = 9
    rows: Corners = 6
    square_mm: SquareMm = 25.0


class CalibratingChange(In):
    """What is given is done."""

    capture: StrictBool = False
    undo: StrictBool = False
    remove: Annotated[str, Field(strict=True, max_length=200)] | None = None
    automatic: StrictBool | None = Field(None, description="Capture new poses by itself.")
    cover_check: StrictBool | None = None


class ComputeStart(In):
    distortion_model: Literal["radtan", "equidistant"] = Field(
        "radtan", description="equidistant is for fisheye lenses."
    )


class CalibrationSave(In):
    name: Name
    activate: StrictBool = True


# --- calibrations ---------------------------------------------------------------------------


class CalibrationChange(In):
    name: Name


class TapeCheckStart(In):
    """A place in the rectified left image, and how far it is by a tape from the left lens."""

    u: Annotated[Finite, Field(ge=0, le=16384)]
    v: Annotated[Finite, Field(ge=0, le=16384)]
    measured_m: Annotated[Finite, Field(gt=0, le=100)]
