"""What goes into the worker, and what comes out of it. Plain frozen dataclasses, as pickles."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from observer.calibration.board import Board
from observer.calibration.views import BoardView
from observer.camera import DistortionModel
from observer.types import Image


@dataclass(frozen=True)
class FitViews:
    """Compute a calibration of boards that were found already.

    Attributes:
        views: as captured. width, height: of the images they were found in.
        frame_rate: of the camera, for what the verdict says of delays; 1/s.
    """

    views: tuple[BoardView, ...]
    board: Board
    width: int
    height: int
    frame_rate: float
    distortion_model: DistortionModel = "radtan"


@dataclass(frozen=True)
class FindBoards:
    """Find the board in the image pairs of a ZIP archive."""

    archive: Path
    board: Board


@dataclass(frozen=True, eq=False)
class RefineRows:
    """Set the rows of a calibration straight by pairs of the scene.

    Attributes:
        pairs: as taken, (H, W) grey. name: what the calibration is called in messages.
    """

    calibration_yaml: str
    name: str
    pairs: tuple[tuple[Image, Image], ...]


Job = FitViews | FindBoards | RefineRows


@dataclass(frozen=True)
class Fitted:
    """A calibration.

    Attributes:
        calibration_yaml: OpenCV FileStorage. report: plain JSON, see
            ``observer.calibration.report.fit_report``.
    """

    calibration_yaml: str
    report: dict[str, Any]


@dataclass(frozen=True)
class BoardsFound:
    """The boards of an archive.

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


@dataclass(frozen=True)
class Refined:
    """A calibration turned by a little.

    Attributes:
        facts: the figures of ``observer.calibration.ageing.row_refinement.RowRefinement``.
    """

    calibration_yaml: str
    facts: dict[str, float]


Result = Fitted | BoardsFound | Refined
