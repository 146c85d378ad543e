"""Messages to and from the worker: plain frozen dataclasses, sent as pickles."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from app.contract.values import JsonObject
from observer.calibration.ageing.row_refinement import RowRefinement
from observer.calibration.ageing.vergence import VergenceCheck
from observer.calibration.boards.board import Board, BoardView
from observer.camera import DistortionModel
from observer.types import Image


@dataclass(frozen=True)
class FitViews:
    """Request to compute a calibration from boards already found.

    Attributes:
        views: board views as captured.
        width, height: size of the images they were found in.
        frame_rate: 1/s, of the camera, for the verdict on delays.
    """

    views: tuple[BoardView, ...]
    board: Board
    width: int
    height: int
    frame_rate: float
    distortion_model: DistortionModel = "radtan"


@dataclass(frozen=True)
class FindBoards:
    """Request to find the board in the image pairs of a ZIP archive."""

    archive: Path
    board: Board


@dataclass(frozen=True, eq=False)
class RefineRows:
    """Request to align the rows of a calibration, using pairs of the scene.

    Attributes:
        pairs: raw pairs, (H, W) grey.
        name: name of the calibration in messages.
        vergence: vergence measured during a drive; also corrected if it has drifted.
    """

    calibration_yaml: str
    name: str
    pairs: tuple[tuple[Image, Image], ...]
    vergence: VergenceCheck | None = None


Job = FitViews | FindBoards | RefineRows


@dataclass(frozen=True)
class Fitted:
    """Computed calibration.

    Attributes:
        calibration_yaml: OpenCV FileStorage.
        report: see ``observer.calibration.report.fit_report``.
    """

    calibration_yaml: str
    report: JsonObject


@dataclass(frozen=True)
class BoardsFound:
    """Boards found in an archive.

    Attributes:
        views: one for each pair in which at least one camera sees the board.
        pictures: small JPEGs of both images, by view.
        refused: one sentence for each image or pair that could not be used.
    """

    views: tuple[BoardView, ...]
    pictures: tuple[tuple[bytes, bytes], ...]
    width: int
    height: int
    refused: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Refined:
    """Calibration corrected by a small rotation, as its file holds it, and what that gained."""

    calibration_yaml: str
    refinement: RowRefinement


Result = Fitted | BoardsFound | Refined
