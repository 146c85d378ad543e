"""A fit and its verdict as plain data, for files, the database and the page."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from observer.calibration.fitting.stereo_fit import DepthBias, StereoFit
from observer.calibration.verdict import CalibrationVerdict


def fit_report(fit: StereoFit, verdict: CalibrationVerdict | None = None) -> dict[str, Any]:
    """Return a fit's report for people; only finite numbers or None, lists and text."""
    c = fit.calibration
    report = {
        "image_width": c.width,
        "image_height": c.height,
        "distortion_model": c.distortion_model,
        "board": {**asdict(fit.board), "words": fit.board.words},
        "rms_left_px": fit.rms_left,
        "rms_right_px": fit.rms_right,
        "rms_stereo_px": fit.rms_stereo,
        "pairs": fit.pairs,
        "views": [asdict(view) for view in fit.views],
        "held_out": None if fit.held_out is None else asdict(fit.held_out),
        "baseline_m": c.baseline,
        "focal_px": [float(c.K1[0, 0]), float(c.K2[0, 0])],
        "field_of_view_deg": fit.field_of_view_deg,
        "rotation_deg": np.degrees(Rotation.from_matrix(c.R).as_rotvec()).tolist(),
        "interval_95": asdict(fit.interval_95),
        "depth_bias": fit.depth_bias.covariances,
        "coverage": fit.coverage,
        "board_bend": None if fit.bend is None else asdict(fit.bend),
        "verdict": None if verdict is None else asdict(verdict),
    }
    return {key: _plain(value) for key, value in report.items()}


def depth_bias_of(report: dict[str, Any]) -> tuple[DepthBias | None, float]:
    """Return what ``tape_check`` needs of a fit, from its report: ``bias`` and ``lasting_px``."""
    rows = report.get("depth_bias") or []
    full = tuple(tuple(float(v) for v in row) for row in rows if len(row) == 4)
    held_out = report.get("held_out")
    lasting = float(held_out["lasting_px"]) if held_out else 0.0
    return (DepthBias(full) if full else None), lasting


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return value
