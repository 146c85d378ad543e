"""Calibrations, and the making of them, as they are told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from app.contract.values import means


@dataclass(frozen=True)
class BoardFacts:
    kind: Literal["chessboard", "charuco"]
    columns: int
    rows: int
    square_mm: float
    words: str


@dataclass(frozen=True)
class BoardLook:
    """Result of looking for the board in the newest pair."""

    words: str
    next: Annotated[str | None, means("Where to hold the board next.")] = None
    coverage: Annotated[Mapping[str, float], means("0 to 1, by name.")] = field(
        default_factory=dict
    )
    missing: Annotated[Sequence[str], means("What still lacks, one sentence each.")] = field(
        default_factory=list
    )
    seen: Annotated[Sequence[int], means("Corners left and right.")] = field(default_factory=list)
    views: Annotated[int, means("How many are captured.")] = 0
    enough: bool = False
    automatic: Annotated[bool, means("Whether new poses are captured by themselves.")] = True
    cover_asked: Annotated[bool, means("Whether one lens shall be covered.")] = False
    covered: Annotated[str | None, means("The side whose lens was covered.")] = None
    frame: Annotated[int | None, means("None: looking at it failed.")] = None


@dataclass(frozen=True)
class CapturedView:
    name: str
    left: Annotated[int, means("Corners seen.")]
    right: int
    picture: bool


@dataclass(frozen=True)
class Computing:
    words: str
    share: float


@dataclass(frozen=True)
class CalibratingFacts:
    source: Annotated[str | None, means("None: images were sent in.")]
    board: BoardFacts
    size: tuple[int, int] | None
    automatic: bool
    look: BoardLook | None
    views: Sequence[CapturedView]
    refused: Annotated[Sequence[str], means("Images that could not be used.")]
    computing: Computing | None
    trouble: Annotated[str | None, means("Why the last computation failed.")]
    result: Annotated[Sequence[str] | None, means("Views that the result rests on.")]


@dataclass(frozen=True)
class CalibratingStatus:
    calibrating: CalibratingFacts | None


@dataclass(frozen=True)
class CalibrationResult:
    views: Sequence[str]
    report: Mapping[str, Any]


@dataclass(frozen=True)
class PlaceDepth:
    range_m: Annotated[float, means("From the left camera, as a tape measures it.")]
    depth_m: Annotated[float, means("Along the camera's axis.")]
    disparity_px: float


@dataclass(frozen=True)
class TapeCheck:
    measured_m: float
    stated_m: float
    expected_m: Annotated[float, means("Half of the 95 % interval of the difference.")]
    agrees: bool
    sentence: str
    at: str


@dataclass(frozen=True)
class Calibration:
    id: Annotated[str, means("SHA-256 of the file's content.")]
    name: str
    width: int
    height: int
    baseline_m: float
    hfov_deg: float
    rectified: bool
    created_at: str
    active: bool
    origin: Annotated[str | None, means("Where it came from, in words.")] = None
    notes: Annotated[Sequence[str], means("What was decided while its file was understood.")] = (
        field(default_factory=list)
    )
    devices: Annotated[Sequence[str], means("The cameras it belongs to.")] = field(
        default_factory=list
    )
    report: Annotated[Mapping[str, Any] | None, means("How good it is, where it is known.")] = None
    tape_checks: Sequence[TapeCheck] = field(default_factory=list)
