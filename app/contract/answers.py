"""Values of the engine's replies to commands, where they are no facts of their own."""

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
        state: as in the ``StateEvent`` that goes before.
        calibration_yaml: the calibration that is used, also where it is the source's own; None
            while calibrating.
    """

    state: StateEvent
    calibration_yaml: str | None


@dataclass(frozen=True)
class KeptClip:
    """A saved half minute: of the file, and how far back it reaches."""

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
    """The points of one frame by which the floor is found.

    ``points``: (N, 3) float64, metres, camera frame.
    """

    frame: int
    points: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ScenePairs:
    """Pairs of the last half minute, (H, W) grey as taken, and the calibration in use.

    ``vergence`` is what the drive told of that calibration's; None before the first frame.
    """

    pairs: tuple[tuple[Image, Image], ...]
    calibration_yaml: str
    vergence: VergenceCheck | None = None
