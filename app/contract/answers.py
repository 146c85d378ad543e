"""Values of the engine's replies to commands, as far as no other module declares them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.contract.events import StateEvent
from observer.calibration.ageing.vergence import VergenceCheck
from observer.types import Image


@dataclass(frozen=True)
class Opened:
    """A source is open.

    Attributes:
        state: as in the ``StateEvent`` that precedes it.
        calibration_yaml: the calibration in use, even if it is the source's own; None while
            calibrating.
    """

    state: StateEvent
    calibration_yaml: str | None


@dataclass(frozen=True)
class KeptClip:
    """Saved half minute: size of its file, and how far back it reaches."""

    bytes: int
    seconds: float


@dataclass(frozen=True, eq=False)
class CalibrationPreview:
    """A rectified pair side by side with lines along its rows.

    Attributes:
        jpeg: left and right image beside each other.
        vertical_error_px: median of ``|v_left - v_right|`` over matched features, None where too
            few were found.
        matches: number of features that were matched.
    """

    jpeg: bytes
    vertical_error_px: float | None
    matches: int


@dataclass(frozen=True, eq=False)
class FloorPoints:
    """Points of one frame for estimating the floor.

    ``points``: (N, 3) float64, metres, camera frame.
    """

    frame: int
    points: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ScenePairs:
    """Pairs of the last half minute, (H, W) grey as taken, and the calibration in use.

    ``vergence`` is that calibration's, as estimated during the drive; None before the first frame.
    """

    pairs: tuple[tuple[Image, Image], ...]
    calibration_yaml: str
    vergence: VergenceCheck | None = None
