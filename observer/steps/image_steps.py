"""Steps 4 to 6: what moves differently from the background, in the image."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from observer.camera import as_gray
from observer.geometry import Float64Array
from observer.methods.planar.image_transformation import transform_images
from observer.steps.formulas import (
    Formula,
    gap,
    matrix,
    row,
    size,
    sub,
    words,
)
from observer.steps.pair import ObservedPair
from observer.steps.paper_step import Number, PaperStep, known_median, lost, percent


def ego_motion_step(pair: ObservedPair) -> PaperStep:
    """Return step 4: the camera's own motion by RANSAC."""
    p, trace = pair.parameters.ego_motion, pair.trace
    ego = trace["ego_motion"]
    inliers = int(ego.inliers.sum())
    numbers = [
        Number("Inliers", inliers),
        Number("Share of the matches", percent(inliers, len(trace["matches"])), "%"),
    ]
    if ego.homography is not None:
        numbers.append(Number("Residual of the inliers, RMS", ego.residual_rms_px, "px", 2))
        numbers += _entries(ego.homography, p.model)
        if p.model == "affine":
            numbers += _operations(trace["decomposition"])
    return PaperStep(
        4,
        "ego_motion",
        "The camera's own motion by RANSAC",
        f"RANSAC finds the {p.model} transformation T that most matches follow to within the "
        "threshold τ. These are the inliers, the static background; outliers are ignored.",
        "Green: inliers. Orange: outliers. Each line leads from t to t+dt.",
        _transformation(p.model),
        tuple(numbers),
        (
            "ego_motion.model",
            "ego_motion.ransac_threshold_px",
            "ego_motion.ransac_iterations",
            "ego_motion.min_inliers",
        ),
        lost(pair),
    )


def _transformation(model: str) -> Formula:
    here, there = matrix([["x"], ["y"], ["1"]]), matrix([["x′"], ["y′"], ["1"]])
    limit = row(gap(), size("x′ − T x"), "≤ τ")
    if model == "affine":
        rows = [[sub("t", f"{r}{c}") for c in (1, 2, 3)] for r in (1, 2)]
        return row(there, "=", matrix([*rows, ["0", "0", "1"]]), here, limit)
    rows = [[sub("h", f"{r}{c}") for c in (1, 2, 3)] for r in (1, 2)]
    last: list[Formula] = [sub("h", "31"), sub("h", "32"), "1"]
    return row(there, "∝", matrix([*rows, last]), here, limit)


def _entries(homography: Float64Array, model: str) -> list[Number]:
    letter, rows = ("t", 2) if model == "affine" else ("h", 3)
    scaled = homography / homography[2, 2]
    numbers = []
    for r in range(rows):
        for c in range(3):
            if (r, c) == (2, 2):
                continue
            shift = c == 2
            name = f"{letter}{str(r + 1).translate(_LOW)}{str(c + 1).translate(_LOW)}"
            digits = 2 if shift else 4 if r < 2 else 7
            numbers.append(Number(name, float(scaled[r, c]), "px" if shift else "", digits))
    return numbers


_LOW = str.maketrans("123", "₁₂₃")


def _operations(decomposition: Mapping[str, Any]) -> list[Number]:
    """Return the matrix as the operations of the paper's table I."""
    angle, shear = decomposition["rotation_rad"], decomposition["shear"]
    x, y = decomposition["scale"]
    return [
        Number("Rotation", float(np.rad2deg(angle)), "°", 3),
        Number("Scale along x", x, "", 4),
        Number("Scale along y", y, "", 4),
        Number("Shear", shear, "", 4),
    ]


def warp_step(pair: ObservedPair) -> PaperStep:
    """Return step 5: image transformation."""
    numbers: tuple[Number, ...] = ()
    if "warped_left" in pair.trace:
        before, after, valid = differences(pair)
        numbers = (
            Number("Mean difference before", float(before[valid].mean()), "grey levels", 1),
            Number("Mean difference after", float(after[valid].mean()), "grey levels", 1),
            Number("Valid area after", 100 * float(valid.mean()), "%", 1),
        )
    return PaperStep(
        5,
        "transformation",
        "Image transformation",
        "The image at t+dt is warped onto the image at t. Static points are then in the same place "
        "in both, and the difference between the images becomes small there.",
        "The brighter, the larger the difference; the black edges have no data.",
        row("I′ ( x ) =", sub("I", "t+dt"), "( T x )"),
        numbers,
        ("ego_motion.model",),
        lost(pair),
    )


def differences(pair: ObservedPair) -> tuple[Float64Array, Float64Array, np.ndarray]:
    """Return the absolute difference of the images of t+dt and t, and where it is known.

    Returns:
        before: (H, W) grey levels. after: (H, W) the same after image transformation. valid:
        (H, W) bool.
    """
    trace = pair.trace
    left, right = as_gray(trace["left"]), as_gray(trace["right"])
    previous = trace["previous_left"].astype(np.float64)
    warped = transform_images(left, right, trace["ego_motion"].homography)
    return np.abs(left - previous), np.abs(warped.left - previous), warped.valid


def flow_step(pair: ObservedPair) -> PaperStep:
    """Return step 6: residual optical flow."""
    numbers: tuple[Number, ...] = ()
    threshold = pair.parameters.flow.residual_threshold_px
    if "dynamic" in pair.trace:
        dynamic = pair.trace["dynamic"]
        length = np.linalg.norm(pair.trace["flow_residual_px"], axis=1)
        numbers = (
            Number("Features tracked", len(dynamic)),
            Number("Dynamic", int(dynamic.sum())),
            Number("Threshold τ", threshold, "px", 1),
            Number("Median residual, static", known_median(length[~dynamic]), "px", 2),
            Number("Median residual, dynamic", known_median(length[dynamic]), "px", 2),
        )
    return PaperStep(
        6,
        "residual_flow",
        "Residual optical flow",
        "The Lucas-Kanade method finds each feature of t in the warped image. A feature that still "
        "moves by more than the threshold τ, with the camera's motion removed, is dynamic.",
        "Red: dynamic. Blue: static. Each line leads from the dot at t to the warped image.",
        row("r = x′ − x", gap(), size("r"), "> τ  ⇒", words("dynamic")),
        numbers,
        (
            "flow.residual_threshold_px",
            "flow.window_px",
            "flow.pyramid_levels",
            "flow.min_texture",
            "flow.max_error",
            "flow.match_brightness",
            "flow.back_check_px",
        ),
        lost(pair),
    )
