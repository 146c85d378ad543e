"""Calibrations and their making, as reported to clients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated

from app.contract.values import JsonObject, means
from observer.calibration.boards.board import BoardKind


@dataclass(frozen=True)
class BoardFacts:
    kind: BoardKind
    columns: int
    rows: int
    square_mm: float
    words: str


@dataclass(frozen=True)
class BoardLook:
    """Result of looking for the board in the newest pair."""

    words: str
    next: Annotated[str | None, means("Where to hold the board next.")] = None
    coverage: Annotated[Mapping[str, float], means("Coverage achieved, from 0 to 1, by name.")] = (
        field(default_factory=dict)
    )
    missing: Annotated[Sequence[str], means("What is still missing, one sentence each.")] = field(
        default_factory=list
    )
    seen: Annotated[Sequence[int], means("Corners found in the left and the right image.")] = field(
        default_factory=list
    )
    views: Annotated[int, means("Number of captured views.")] = 0
    enough: bool = False
    automatic: Annotated[bool, means("Whether new poses are captured automatically.")] = True
    cover_asked: Annotated[bool, means("Whether the operator is asked to cover one lens.")] = False
    covered: Annotated[str | None, means("The side whose lens was covered.")] = None
    frame: Annotated[int | None, means("null: detection failed.")] = None


@dataclass(frozen=True)
class CapturedView:
    name: str
    left: Annotated[int, means("Corners found.")]
    right: int
    picture: bool


@dataclass(frozen=True)
class Computing:
    words: str
    share: float


@dataclass(frozen=True)
class CalibratingFacts:
    source: Annotated[str | None, means("null: uploaded images are used.")]
    board: BoardFacts
    size: tuple[int, int] | None
    automatic: bool
    look: BoardLook | None
    views: Sequence[CapturedView]
    refused: Annotated[Sequence[str], means("Images that could not be used.")]
    computing: Computing | None
    trouble: Annotated[str | None, means("Why the last computation failed.")]
    result: Annotated[Sequence[str] | None, means("Views on which the result is based.")]


@dataclass(frozen=True)
class CalibratingStatus:
    calibrating: CalibratingFacts | None


@dataclass(frozen=True)
class CalibrationResult:
    views: Sequence[str]
    report: JsonObject


@dataclass(frozen=True)
class PlaceDepth:
    range_m: Annotated[
        float, means("Straight distance from the left camera, as measured with a tape.")
    ]
    depth_m: Annotated[float, means("Depth along the optical axis.")]
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
    notes: Annotated[Sequence[str], means("Assumptions made when its file was read.")] = field(
        default_factory=list
    )
    devices: Annotated[Sequence[str], means("The cameras it belongs to.")] = field(
        default_factory=list
    )
    report: Annotated[JsonObject | None, means("Its accuracy, if known.")] = None
    tape_checks: Sequence[TapeCheck] = field(default_factory=list)
