"""Report on the accuracy of calibrations as Markdown."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence

from observer.evaluation.calibration_accuracy import (
    BOARD_SCENARIO,
    DEPTH_M,
    DEPTH_SCENARIO,
    CalibrationAccuracy,
    calibration_targets,
)
from observer.evaluation.evaluate import markdown_table, shown
from observer.evaluation.targets import targets_table

_Figure = Callable[[CalibrationAccuracy], float | int | None]
_CAMERAS: dict[str, _Figure] = {
    "poses": lambda r: r.poses,
    "pairs": lambda r: r.pairs,
    "refused": lambda r: r.refused,
    "focal length, %": lambda r: r.errors.focal_percent,
    "baseline, %": lambda r: r.errors.baseline_percent,
    "rotation, deg": lambda r: r.errors.rotation_deg,
    "rotation about y, deg": lambda r: r.errors.turn_y_deg,
    "apparent vergence, deg": lambda r: r.errors.vergence_deg,
    "reprojection error, RMS, px": lambda r: r.rms_px,
    "epipolar error, held-out views, 95th percentile, px": lambda r: r.held_out_p95_px,
    "epipolar error, exact corners, 95th percentile, px": lambda r: r.exact_p95_px,
    "detection, s": lambda r: r.detection_s,
    "fit, s": lambda r: r.fit_s,
}
_DEPTH: dict[str, _Figure] = {
    "matched": lambda r: r.depth.matched,
    "median, %": lambda r: r.depth.median_percent,
    "bias, %": lambda r: r.depth.bias_percent,
    "spread, %": lambda r: r.depth.spread_percent,
    "true calibration: median, %": lambda r: r.depth_by_truth.median_percent,
    "true calibration: bias, %": lambda r: r.depth_by_truth.bias_percent,
    "true calibration: spread, %": lambda r: r.depth_by_truth.spread_percent,
}


def calibration_markdown(runs: Sequence[CalibrationAccuracy]) -> str:
    """Return tables of targets, and of errors of the cameras and of depth by seed."""
    near, far = DEPTH_M
    return "\n".join(
        [
            f"## Calibration of the simulated cameras (`{BOARD_SCENARIO}`), targets\n",
            targets_table(calibration_targets(runs), "figure over all seeds"),
            "## Errors of the cameras, by seed\n",
            _by_seed(runs, _CAMERAS),
            f"## Distances at {near:g} to {far:g} m in `{DEPTH_SCENARIO}` with them, by seed\n",
            _by_seed(runs, _DEPTH),
        ]
    )


def _by_seed(runs: Sequence[CalibrationAccuracy], figures: dict[str, _Figure]) -> str:
    """Return a row for each seed, then rows of the medians and the largest absolute values."""
    rows = [[str(run.seed), *(shown(figure(run)) for figure in figures.values())] for run in runs]
    known = [[v for run in runs if (v := figure(run)) is not None] for figure in figures.values()]
    rows.append(["median", *(shown(statistics.median(each) if each else None) for each in known)])
    rows.append(["largest", *(shown(max(each, key=abs, default=None)) for each in known)])
    return markdown_table(["seed", *figures], rows)
