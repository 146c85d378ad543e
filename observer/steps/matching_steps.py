"""Steps 1 to 3: the images, their features, and the matches."""

from __future__ import annotations

import numpy as np

from observer.steps.formulas import (
    Formula,
    frac,
    gap,
    row,
    size,
    sub,
    sup,
    under,
    words,
)
from observer.steps.pair import ObservedPair
from observer.steps.paper_step import Number, PaperStep, known_median, percent


def images_step(pair: ObservedPair) -> PaperStep:
    """Return step 1: the rectified pair at t and at t+dt."""
    height, width = pair.trace["left"].shape[:2]
    camera = pair.camera
    return PaperStep(
        1,
        "pair",
        "Stereo pair at t and t+dt",
        "Both cameras take an image at t and again at t+dt. Rectification warps the images so that "
        "a point lies in the same row of the left and the right image.",
        "Above: left and right at t. Below: left and right at t+dt. Orange: one row of each pair.",
        row(
            "dt =", sub("t", "2"), "−", sub("t", "1"), gap(),
            sub("v", words("left")), "=", sub("v", words("right")),
        ),
        (
            Number("dt", pair.dt, "s", 3),
            Number("t", float(pair.trace["previous_time"]), "s", 3),
            Number("Image width", width, "px"),
            Number("Image height", height, "px"),
            Number("Focal length", camera.fx, "px", 1),
            Number("Baseline", 1000 * camera.baseline, "mm", 1),
        ),
        ("frames.interval",),
    )  # fmt: skip


def features_step(pair: ObservedPair) -> PaperStep:
    """Return step 2: feature points at t."""
    p = pair.parameters.features
    px = pair.trace["features_px"]
    return PaperStep(
        2,
        "features",
        "Feature points",
        _DETECTOR_WORDS[p.detector] + " Each cell of a grid gets an equal share of the points.",
        "Green stars: feature points in the left image at t.",
        _DETECTOR_FORMULAS[p.detector],
        (
            Number("Feature points", len(px)),
            Number("Maximum", p.max_count),
            Number("Grid columns", p.grid_cells),
        ),
        (
            "features.detector",
            "features.max_count",
            "features.grid_cells",
            *(("features.fast_threshold",) if p.detector in _BY_CONTRAST else ()),
            *(("features.quality",) if p.detector in _BY_QUALITY else ()),
        ),
    )


_BY_CONTRAST = ("fast", "brisk", "orb")
_BY_QUALITY = ("shi_tomasi", "harris")
_FAST = (
    "A point is a corner if a run of 9 of the 16 pixels on a circle around it is brighter or "
    "darker than the point by more than the threshold τ (FAST)."
)
_FAST_FORMULA = row(size("I (", sub("x", "k"), ") − I ( x )"), "> τ")
_HESSIAN = "Points are local maxima of the determinant of the second derivatives."
_HESSIAN_FORMULA = row(
    "det H =", sub("L", "xx"), sub("L", "yy"), "−", sup(sub("L", "xy"), "2")
)  # fmt: skip
_DETECTOR_WORDS = {
    "fast": _FAST,
    "orb": _FAST + " ORB repeats this at several scales.",
    "brisk": _FAST + " BRISK repeats this at several scales.",
    "shi_tomasi": "A point is a corner if the image varies in every direction around it: the "
    "smaller eigenvalue of its gradient matrix M is large (Shi and Tomasi).",
    "harris": "A point is a corner if the image varies in every direction around it, as measured "
    "by the determinant and the trace of its gradient matrix M (Harris and Stephens).",
    "kaze": _HESSIAN + " KAZE smooths without blurring across edges.",
    "surf": _HESSIAN + " SURF approximates them by box filters.",
    "mser": "Points are the centres of regions whose area A hardly changes with the grey level g "
    "at which they are cut out (MSER).",
}
_DETECTOR_FORMULAS: dict[str, Formula] = {
    "fast": _FAST_FORMULA,
    "orb": _FAST_FORMULA,
    "brisk": _FAST_FORMULA,
    "shi_tomasi": row(sub("λ", "min"), "( M ) > q", words(" max "), sub("λ", "min")),
    "harris": row("det M − k", sup(words("tr"), "2"), "M > q", words(" max")),
    "kaze": _HESSIAN_FORMULA,
    "surf": _HESSIAN_FORMULA,
    "mser": row(frac("d A", "A d g"), words(" minimal")),
}


def matches_step(pair: ObservedPair) -> PaperStep:
    """Return step 3: the same points at t+dt."""
    p, matches = pair.parameters, pair.trace["matches"]
    shift = np.linalg.norm(matches.current - matches.previous, axis=1)
    largest = float(shift.max()) if len(shift) else None
    klt = p.matching.method == "klt"
    share = percent(len(matches), len(pair.trace["features_px"]))
    numbers = (
        Number("Matches", len(matches)),
        Number("Share of the features", share, "%"),
        Number("Median shift", known_median(shift), "px", 2),
        Number("Largest shift", largest, "px", 1),
    )  # fmt: skip
    title = "Matches from t to t+dt"
    caption = "Blue: the path of each match, from the dot at t to its place at t+dt."
    own = ("matching.method", "matching.cross_check", "matching.max_shift")
    if klt:
        return PaperStep(
            3,
            "matches",
            title,
            "The Lucas-Kanade method (KLT) shifts a window W around each feature until it best "
            "fits the image at t+dt; d is the shift.",
            caption,
            row(
                under("min", "d"), under("∑", row("x ∈ W")),
                sup(row("(", sub("I", "t+dt"), "( x + d ) −", sub("I", "t"), "( x )", ")"), "2"),
            ),
            numbers,
            (*own, "flow.window_px", "flow.pyramid_levels", "flow.min_texture", "flow.max_error",
             "flow.match_brightness", "flow.back_check_px"),
        )  # fmt: skip
    return PaperStep(
        3,
        "matches",
        title,
        "Features are detected at t+dt, too. Two match if the distance h of their descriptors f is "
        "the smallest, and clearly smaller than to the second best (ratio ρ).",
        caption,
        row(
            "h (", sub("f", "t"), ",", sub("f", "t+dt"), ") ≤ ρ h (",
            sub("f", "t"), ",", sub("f", words("second")), ")",
        ),
        numbers,
        (*own, "matching.ratio"),
    )  # fmt: skip
