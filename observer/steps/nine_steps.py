"""The nine steps of the paper, each with its formula, its numbers and its parameters.

They are counted as the modules of ``observer.methods.planar`` and ``observer.vision`` count them:
1 a rectified pair at t and at t+dt, 2 features, 3 matches, 4 the camera's own motion, 5 image
transformation, 6 residual optical flow, 7 stereo, 8 displacement over dt, 9 obstacles.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from observer.camera import as_gray
from observer.geometry import Float64Array
from observer.intervals import half_95
from observer.methods.planar.image_transformation import transform_images
from observer.steps.formulas import (
    Formula,
    frac,
    gap,
    matrix,
    row,
    size,
    sub,
    sup,
    under,
    words,
)
from observer.steps.pair import ObservedPair
from observer.types import Obstacle
from observer.vision.stereo import sample_disparity


@dataclass(frozen=True)
class Number:
    """A figure of a step.

    Attributes:
        name: for people. value: None where it is not known. digits: worth showing after the point.
    """

    name: str
    value: float | None
    unit: str = ""
    digits: int = 0


@dataclass(frozen=True)
class PaperStep:
    """One step of the method on one pair.

    Attributes:
        number: from 1 to 9. key: for files and code. title, text: for people.
        caption: what the colours in its picture mean.
        formula: with the names that the text uses.
        numbers: of this pair.
        parameters: dotted names of those that act in this step.
        missing: why it has no result in this frame; None where it has one.
    """

    number: int
    key: str
    title: str
    text: str
    caption: str
    formula: Formula
    numbers: tuple[Number, ...]
    parameters: tuple[str, ...]
    missing: str | None = None


def nine_steps(pair: ObservedPair) -> tuple[PaperStep, ...]:
    """Return all nine steps of an observed pair, in order."""
    return tuple(step(pair) for step in _STEPS)


# --- 1 to 3: what is seen twice ----------------------------------------------------------------


def _images(pair: ObservedPair) -> PaperStep:
    height, width = pair.trace["left"].shape[:2]
    camera = pair.camera
    return PaperStep(
        1,
        "pair",
        "Stereo pair at t and t+dt",
        "Both cameras take an image at t and again at t+dt. Rectification turns the images so that "
        "a point lies in the same row of the left and the right one.",
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


def _features(pair: ObservedPair) -> PaperStep:
    p = pair.parameters.features
    px = pair.trace["features_px"]
    return PaperStep(
        2,
        "features",
        "Feature points",
        _DETECTOR_WORDS[p.detector] + " Each cell of a grid keeps an equal share of the points.",
        "Green stars: feature points in the left image at t.",
        _DETECTOR_FORMULAS[p.detector],
        (
            Number("Feature points", len(px)),
            Number("Most that are kept", p.max_count),
            Number("Columns of the grid", p.grid_cells),
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
_HESSIAN = "Points are where the determinant of the second derivatives is largest."
_HESSIAN_FORMULA = row(
    "det H =", sub("L", "xx"), sub("L", "yy"), "−", sup(sub("L", "xy"), "2")
)  # fmt: skip
_DETECTOR_WORDS = {
    "fast": _FAST,
    "orb": _FAST + " ORB repeats that at several scales.",
    "brisk": _FAST + " BRISK repeats that at several scales.",
    "shi_tomasi": "A point is a corner if the image varies in every direction around it: the "
    "smaller eigenvalue of its gradient matrix M is large (Shi and Tomasi).",
    "harris": "A point is a corner if the image varies in every direction around it, by the "
    "determinant and the trace of its gradient matrix M (Harris and Stephens).",
    "kaze": _HESSIAN + " KAZE blurs without crossing edges.",
    "surf": _HESSIAN + " SURF uses sums over boxes.",
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


def _matches(pair: ObservedPair) -> PaperStep:
    p, matches = pair.parameters, pair.trace["matches"]
    shift = np.linalg.norm(matches.current - matches.previous, axis=1)
    median = float(np.median(shift)) if len(shift) else None
    largest = float(shift.max()) if len(shift) else None
    klt = p.matching.method == "klt"
    share = _percent(len(matches), len(pair.trace["features_px"]))
    numbers = (
        Number("Matches", len(matches)),
        Number("Share of the features", share, "%"),
        Number("Median shift", median, "px", 2),
        Number("Largest shift", largest, "px", 1),
    )  # fmt: skip
    title = "Matches from t to t+dt"
    caption = "Blue: the way of each match, from the dot at t to where it is at t+dt."
    own = ("matching.method", "matching.cross_check", "matching.max_shift")
    if klt:
        return PaperStep(
            3,
            "matches",
            title,
            "Lucas and Kanade's method (KLT) shifts a window W around each feature until it fits "
            "the image at t+dt best; d is the shift.",
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
        "Features are found at t+dt, too. Two belong together if their feature values f are the "
        "most alike, by the distance h, and clearly more alike than the second best (ratio ρ).",
        caption,
        row(
            "h (", sub("f", "t"), ",", sub("f", "t+dt"), ") ≤ ρ h (",
            sub("f", "t"), ",", sub("f", words("second")), ")",
        ),
        numbers,
        (*own, "matching.ratio"),
    )  # fmt: skip


# --- 4 to 6: what moves otherwise than the background ------------------------------------------


def _ego_motion(pair: ObservedPair) -> PaperStep:
    p, trace = pair.parameters.ego_motion, pair.trace
    ego = trace["ego_motion"]
    inliers = int(ego.inliers.sum())
    numbers = [
        Number("Inliers", inliers),
        Number("Share of the matches", _percent(inliers, len(trace["matches"])), "%"),
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
        "threshold τ. These are inliers, the static background; the others do not take part.",
        "Green: inliers. Orange: outliers. Each line leads from t to t+dt.",
        _transformation(p.model),
        tuple(numbers),
        (
            "ego_motion.model",
            "ego_motion.ransac_threshold_px",
            "ego_motion.ransac_iterations",
            "ego_motion.min_inliers",
        ),
        None if ego.homography is not None else _lost(pair),
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
    """Return what the matrix does, by the operations of the paper's table I."""
    angle, shear = decomposition["rotation_rad"], decomposition["shear"]
    x, y = decomposition["scale"]
    return [
        Number("Rotation", float(np.rad2deg(angle)), "°", 3),
        Number("Scale along x", x, "", 4),
        Number("Scale along y", y, "", 4),
        Number("Shear", shear, "", 4),
    ]


def _warp(pair: ObservedPair) -> PaperStep:
    numbers: tuple[Number, ...] = ()
    if "warped_left" in pair.trace:
        before, after, valid = differences(pair)
        numbers = (
            Number("Mean difference before", float(before[valid].mean()), "grey levels", 1),
            Number("Mean difference after", float(after[valid].mean()), "grey levels", 1),
            Number("Image that is known after", 100 * float(valid.mean()), "%", 1),
        )
    return PaperStep(
        5,
        "transformation",
        "Image transformation",
        "The images of t+dt are transformed into the frame of the image at t. What stands is then "
        "in the same place in both, and the difference of the images becomes small there.",
        "The brighter a difference, the larger it is; black at the edges is not known.",
        row("I′ ( x ) =", sub("I", "t+dt"), "( T x )"),
        numbers,
        ("ego_motion.model",),
        _lost_or_none(pair),
    )


def differences(pair: ObservedPair) -> tuple[Float64Array, Float64Array, np.ndarray]:
    """Return the image of t+dt minus that of t, as sizes, and where that is known.

    Returns:
        before: (H, W) grey levels. after: (H, W) the same after image transformation. valid:
        (H, W) bool.
    """
    trace = pair.trace
    left, right = as_gray(trace["left"]), as_gray(trace["right"])
    previous = trace["previous_left"].astype(np.float64)
    warped = transform_images(left, right, trace["ego_motion"].homography)
    return np.abs(left - previous), np.abs(warped.left - previous), warped.valid


def _flow(pair: ObservedPair) -> PaperStep:
    numbers: tuple[Number, ...] = ()
    threshold = pair.parameters.flow.residual_threshold_px
    if "dynamic" in pair.trace:
        dynamic = pair.trace["dynamic"]
        length = np.linalg.norm(pair.trace["flow_residual_px"], axis=1)
        numbers = (
            Number("Features followed", len(dynamic)),
            Number("Dynamic", int(dynamic.sum())),
            Number("Threshold τ", threshold, "px", 1),
            Number("Median residual, static", _median(length[~dynamic]), "px", 2),
            Number("Median residual, dynamic", _median(length[dynamic]), "px", 2),
        )
    return PaperStep(
        6,
        "residual_flow",
        "Residual optical flow",
        "Lucas and Kanade's method finds each feature of t in the transformed image. What moved by "
        "more than the threshold τ, although the camera's motion is taken out, is dynamic.",
        "Red: dynamic. Blue: static. Each line leads from the dot at t to the transformed image.",
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
        _lost_or_none(pair),
    )


# --- 7 to 9: where and how fast ----------------------------------------------------------------


def _stereo(pair: ObservedPair) -> PaperStep:
    trace, camera = pair.trace, pair.camera
    disparity = trace["disparity"]
    numbers = [
        Number("Pixels with a disparity", 100 * float(np.isfinite(disparity).mean()), "%", 1),
        Number("f b", camera.fx * camera.baseline, "px m", 2),
    ]
    if "motions" in trace:
        count = len(trace["motions"].points_previous)
        depth = _median(trace["motions"].points_previous[:, 2])
        found = sample_disparity(disparity, trace["flow_px"][trace["dynamic"]])
        numbers += [
            Number("Dynamic points with a position", count),
            Number("Their median disparity", _median(found[np.isfinite(found)]), "px", 1),
            Number("Their median depth", depth, "m", 2),
        ]
    return PaperStep(
        7,
        "stereo",
        "Stereo: disparity and position",
        "The disparity d is how far a point lies further left in the right image. With the focal "
        "length f and the baseline b it gives the depth Z, and with the pixel the position.",
        "Colour: disparity, near is red, unknown is dark. Red points: dynamic.",
        row(
            "Z =", frac("f b", "d"), gap(),
            "X =", frac(row("( u −", sub("c", "x"), ") Z"), "f"), gap(),
            "Y =", frac(row("( v −", sub("c", "y"), ") Z"), "f"),
        ),
        tuple(numbers),
        (
            "stereo.matcher",
            "stereo.max_disparity_px",
            "stereo.block_px",
            "stereo.uniqueness_percent",
            "stereo.min_depth_m",
            "stereo.max_depth_m",
        ),
    )  # fmt: skip


def _displacement(pair: ObservedPair) -> PaperStep:
    numbers: tuple[Number, ...] = ()
    if "motions" in pair.trace:
        motions = pair.trace["motions"]
        way = np.linalg.norm(motions.points_current - motions.points_previous, axis=1)
        speed = np.linalg.norm(motions.velocity, axis=1)
        numbers = (
            Number("Points", len(way)),
            Number("dt", pair.dt, "s", 3),
            Number("Median displacement", _scaled(_median(way), 1000), "mm", 0),
            Number("Median speed of a point", _median(speed), "m/s", 2),
        )
    return PaperStep(
        8,
        "displacement",
        "Displacement over dt",
        "Both clouds have the camera at t as their origin, so a static point P has the same place "
        "in both. The displacement of a dynamic point, over dt, is its velocity v.",
        "Red: from each dynamic point an arrow as long as its way in one second, from above.",
        row("v =", frac(row(sub("P", "t+dt"), "−", sub("P", "t")), "dt")),
        numbers,
        (
            "motion.max_speed_mps",
            "motion.disparity_sigma_px",
            "motion.pixel_sigma_px",
            "stereo.min_depth_m",
            "stereo.max_depth_m",
        ),
        _lost_or_none(pair),
    )


def _obstacles(pair: ObservedPair) -> PaperStep:
    detections = pair.trace.get("detections", ())
    shown = shown_obstacles(pair)
    numbers = [
        Number("Clusters in this frame", len(detections)),
        Number("Obstacles reported", len(shown)),
    ]
    for one in shown:
        numbers += _of_obstacle(pair, one)
    if pair.truth is not None:
        found = {one.id for one in shown}
        numbers += [
            Number(f"Not found: {body.name}, true speed", body.speed_mps, "m/s", 2)
            for body in pair.truth
            if body.track_id not in found
        ]
    return PaperStep(
        9,
        "obstacles",
        "Obstacles: cluster, speed, identity",
        "Dynamic points closer together than r are one obstacle; its speed is the length of their "
        "mean velocity. It is reported once it was seen in several frames.",
        "Yellow: obstacles with their speed. Green stars: their points. White, dashed: too new to "
        "be reported.",
        row(
            size(sub("P", "i"), "−", sub("P", "j")), "≤ r", gap(),
            words("speed"), "=", size(frac("1", "n"), under("∑", "i"), sub("v", "i")),
        ),
        tuple(numbers),
        (
            "clustering.radius_m",
            "clustering.min_points",
            "motion.min_significance",
            "motion.noise_correlation",
            "motion.turn_sigma_radps",
            "tracking.gate",
            "tracking.confirm_hits",
            "tracking.coast_frames",
        ),
        _lost_or_none(pair),
    )  # fmt: skip


def shown_obstacles(pair: ObservedPair) -> tuple[Obstacle, ...]:
    """Return the reported obstacles of the pair that were seen in it."""
    return tuple(one for one in pair.observation.reported if one.points)


def true_speed_of(pair: ObservedPair, track_id: int) -> float | None:
    """Return the true speed of the body that an obstacle was matched with, m/s; None unknown."""
    bodies = pair.truth or ()
    return next((body.speed_mps for body in bodies if body.track_id == track_id), None)


def _of_obstacle(pair: ObservedPair, one: Obstacle) -> list[Number]:
    numbers = [Number(f"#{one.id}: speed", one.speed, "m/s", 2)]
    if one.speed_std is not None:
        numbers.append(Number(f"#{one.id}: 95 % interval, ±", half_95(one.speed_std), "m/s", 2))
    true = true_speed_of(pair, one.id)
    if true is not None:
        numbers.append(Number(f"#{one.id}: true speed", true, "m/s", 2))
        numbers.append(Number(f"#{one.id}: error", one.speed - true, "m/s", 2))
    numbers.append(Number(f"#{one.id}: points", one.points))
    numbers.append(Number(f"#{one.id}: distance", one.range, "m", 2))
    return numbers


# --- common ------------------------------------------------------------------------------------


def is_planar_result(pair: ObservedPair) -> bool:
    """Return whether the pair came as far as the image transformation."""
    return pair.trace["ego_motion"].homography is not None


def _lost_or_none(pair: ObservedPair) -> str | None:
    return None if is_planar_result(pair) else _lost(pair)


def _lost(pair: ObservedPair) -> str:
    why = "; ".join(pair.trace["ego_motion"].reasons)
    return f"The ego-motion is lost in this frame: {why}. Choose another frame or threshold."


def _percent(count: int, total: int) -> float | None:
    return 100 * count / total if total else None


def _median(values: Float64Array) -> float | None:
    return float(np.median(values)) if len(values) else None


def _scaled(value: float | None, factor: float) -> float | None:
    return None if value is None else factor * value


_STEPS: tuple[Callable[[ObservedPair], PaperStep], ...] = (
    _images,
    _features,
    _matches,
    _ego_motion,
    _warp,
    _flow,
    _stereo,
    _displacement,
    _obstacles,
)
COUNT = len(_STEPS)
