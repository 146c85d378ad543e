"""Values as an engine gives them: a frame's line and truth, a board's corners, a calibration."""

from __future__ import annotations

from typing import Any

import numpy as np

from app.contract.events import LiveLine
from observer.calibration.boards.board import Board, BoardSighting
from observer.calibration.formats.opencv_file import calibration_text
from observer.camera import StereoCalibration
from observer.truth.matching import TrueBodyEntry

# The smallest valid JPEG would do; the bytes are only passed on.
JPEG = b"\xff\xd8\xff\xe0 not a picture, but carried like one \xff\xd9"


def line(frame: int, segment: int, revision: int, padding: str) -> LiveLine:
    """Return a JSON line with one obstacle that moves to the right at 0.4 m/s."""
    at = [0.4 * frame / 15, 0.1, 3.0]
    return {
        "frame": frame,
        "time": frame / 15,
        "segment": segment,
        "status": "ok",
        "reasons": [padding] if padding else [],
        "parameters_revision": revision,
        "pose": {"position": [0.0, 0.0, 0.02 * frame], "orientation_wxyz": [1.0, 0, 0, 0]},
        "obstacles": [
            {
                "id": 7,
                "state": "confirmed",
                "motion": "moving",
                "position": at,
                "velocity": [0.4, 0.0, 0.0],
                "speed": 0.4,
                "speed_std": 0.05,
                "position_cov": None,
                "velocity_cov": None,
                "velocity_time": frame / 15,
                "size": [0.5, 0.3, 0.4],
                "orientation_wxyz": [1.0, 0.0, 0.0, 0.0],
                "range": 3.0,
                "bearing": 0.1,
                "closing_speed": 0.0,
                "points": 20,
                "significance": 8.0,
                "box_px": [100.0, 50.0, 160.0, 90.0],
                "why": "its flow differs from the background's",
            }
        ],
        "unseen": None,
        "timings_ms": {"features": 1.0 + frame % 3, "total": 20.0},
    }


def truth(frame: int) -> TrueBodyEntry:
    return {
        "id": 1,
        "name": "P3-DX",
        "role": "obstacle",
        "position": [0.4 * frame / 15, 0.1, 3.0],
        "velocity": [0.4, 0.0, 0.0],
        "speed": 0.4,
        "size": [0.455, 0.381, 0.237],
        "yaw": 1.5708,
        "visible": 1.0,
        "commanded_speed": 0.4,
        "track_id": 7,
    }


def sighting_of(board: Board) -> BoardSighting:
    """All corners of a board, somewhere in an image."""
    px = board.object_points[:, :2] / board.square_m * 20.0 + 50.0
    return BoardSighting(np.arange(len(px), dtype=np.int32), px)


def floor_points(seed: int, height_m: float = 0.4, count: int = 3000) -> np.ndarray[Any, Any]:
    """Return a floor below a level camera, (N, 3) metres in its frame, a millimetre rough."""
    rng = np.random.default_rng(seed)
    points = np.column_stack(
        [rng.uniform(-1, 1, count), np.full(count, height_m), rng.uniform(1.2, 4, count)]
    )
    points[:, 1] += rng.normal(0, 0.001, count)
    return points


def rectified_calibration(width: int = 512, height: int = 256) -> str:
    """The text of a calibration file."""
    return calibration_text(
        StereoCalibration.rectified(width, height, 443.0, 443.0, 255.5, 127.5, 0.12)
    )
