"""Calibrations, and the making of them, as OpenAPI shows them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StrictBool, StrictInt

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


class BoardFacts(BaseModel):
    kind: BoardKind
    columns: int
    rows: int
    square_mm: float
    words: str


class BoardLook(BaseModel):
    """What was made of the newest pair."""

    model_config = ConfigDict(extra="allow")

    words: str
    next: str | None = Field(None, description="Where to hold the board next.")
    coverage: dict[str, float] = Field(default_factory=dict, description="0 to 1, by name.")
    seen: list[int] = Field(default_factory=list, description="Corners left and right.")
    enough: bool = False
    covered: str | None = Field(None, description="The side whose lens was covered.")


class CapturedView(BaseModel):
    name: str
    left: int = Field(description="Corners seen.")
    right: int
    picture: bool


class Computing(BaseModel):
    words: str
    share: float


class CalibratingFacts(BaseModel):
    source: str | None = Field(description="None: images were sent in.")
    board: BoardFacts
    size: tuple[int, int] | None
    automatic: bool
    look: BoardLook | None
    views: list[CapturedView]
    refused: list[str] = Field(description="Images that could not be used.")
    computing: Computing | None
    trouble: str | None = Field(description="Why the last computation failed.")
    result: list[str] | None = Field(description="Views that the result rests on.")


class CalibratingStatus(BaseModel):
    calibrating: CalibratingFacts | None


class CalibrationResult(BaseModel):
    views: list[str]
    report: dict[str, Any]


# --- calibrations ---------------------------------------------------------------------------


class CalibrationChange(In):
    name: Name


class TapeCheckStart(In):
    """A place in the rectified left image, and how far it is by a tape from the left lens."""

    u: Annotated[Finite, Field(ge=0, le=16384)]
    v: Annotated[Finite, Field(ge=0, le=16384)]
    measured_m: Annotated[Finite, Field(gt=0, le=100)]


class PlaceDepth(BaseModel):
    range_m: float = Field(description="From the left camera, as a tape measures it.")
    depth_m: float = Field(description="Along the camera's axis.")
    disparity_px: float


class TapeCheck(BaseModel):
    measured_m: float
    stated_m: float
    expected_m: float = Field(description="Two standard deviations of the difference.")
    agrees: bool
    sentence: str
    at: str


class Calibration(BaseModel):
    id: str = Field(description="SHA-256 of the file's content.")
    name: str
    width: int
    height: int
    baseline_m: float
    hfov_deg: float
    rectified: bool
    created_at: str
    active: bool
    origin: str | None = Field(None, description="Where it came from, in words.")
    notes: list[str] = Field(
        default_factory=list, description="What was decided while its file was understood."
    )
    devices: list[str] = Field(default_factory=list, description="The cameras it belongs to.")
    report: dict[str, Any] | None = Field(None, description="How good it is, where it is known.")
    tape_checks: list[TapeCheck] = Field(default_factory=list)
