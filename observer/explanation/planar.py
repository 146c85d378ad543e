"""Reasons of the planar methods: residual flow after removing one planar motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from observer.camera import StereoCamera
from observer.explanation.answer import (
    Nearby,
    PixelAnswer,
    PixelVerdict,
    above,
    below,
    distances,
    known,
    limits,
    look_around,
    radius_px,
)
from observer.explanation.texture import why_no_feature
from observer.geometry import Float64Array, map_pixels
from observer.methods.planar.clustering import detect_obstacles, group_points
from observer.methods.planar.results import Detection, PointMotions
from observer.number_format import count_of
from observer.parameters import ClusteringParameters, MotionParameters, Parameters
from observer.trace import TraceValues

_THRESHOLD = "flow.residual_threshold_px"
# Half the side of the square whose disparities give a pixel's depth, and the share of them that
# must be known.
_DEPTH_REACH_PX = 3
_DEPTH_KNOWN = 0.25

_Judgement = tuple[PixelVerdict, str, str, dict[str, float | None]]


@dataclass(frozen=True, eq=False)
class _Place:
    """The pixel with all that is known around it.

    Attributes:
        residual_px: median residual of the features that decide for it.
        depth: metres, NaN = unknown. dt: seconds between the two images.
    """

    trace: TraceValues
    camera: StereoCamera
    parameters: Parameters
    px: tuple[float, float]
    near: Nearby
    residual_px: float
    depth: float
    dt: float


def explain_by_flow(
    trace: TraceValues,
    camera: StereoCamera,
    parameters: Parameters,
    px: tuple[float, float],
    counts: Mapping[str, float],
) -> PixelAnswer:
    """Return the answer given by the residual motion of the nearest features.

    Args:
        counts: figures of the camera's own motion, shown with the answer's.
    """
    H = trace["ego_motion"].homography
    if H is None or "flow_residual_px" not in trace:
        return PixelAnswer(
            px,
            PixelVerdict.UNDECIDED,
            "Motion was not tested in this frame.",
            dict(counts),
            "Ask again on the next frame.",
        )
    # The image of t+dt was warped to t by the inverse of H; H maps the features back.
    near = look_around(map_pixels(H, trace["flow_observed_px"]), px, camera)
    px_previous = map_pixels(np.linalg.inv(H), px)[0]
    depth = _depth_at(trace["disparity"], px_previous, camera)
    numbers = near.numbers | {"depth_m": known(depth)} | dict(counts)
    if len(near.members) == 0:
        sentence, change = why_no_feature(trace, parameters, px_previous, near)
        return PixelAnswer(px, PixelVerdict.TOO_FEW_FEATURES, sentence, numbers, change)
    lengths = np.linalg.norm(trace["flow_residual_px"][near.speakers], axis=1)
    residual = float(np.median(lengths))
    dt = float(trace["time"] - trace["previous_time"])
    place = _Place(trace, camera, parameters, px, near, residual, depth, dt)
    numbers |= {"residual_px": residual, "threshold_px": parameters.flow.residual_threshold_px}
    if depth > parameters.stereo.max_depth_m:
        sentence, change = _too_far_words(depth, parameters.stereo.max_depth_m)
        return PixelAnswer(px, PixelVerdict.TOO_FAR, sentence, numbers, change)
    judge = _moved if residual > parameters.flow.residual_threshold_px else _stood
    verdict, sentence, change, more = judge(place)
    return PixelAnswer(px, verdict, sentence, numbers | more, change)


def _depth_at(disparity: Float64Array, px: Float64Array, camera: StereoCamera) -> float:
    """Return the depth, metres, by the median disparity around a pixel of t; NaN if unknown."""
    u, v = (round(float(c)) for c in px)
    rows = slice(max(0, v - _DEPTH_REACH_PX), max(0, v + _DEPTH_REACH_PX + 1))
    columns = slice(max(0, u - _DEPTH_REACH_PX), max(0, u + _DEPTH_REACH_PX + 1))
    around = disparity[rows, columns]
    seen = around[around > 0]
    if around.size == 0 or seen.size < _DEPTH_KNOWN * around.size:
        return float("nan")
    return camera.fb / float(np.median(seen))


def _speakers(place: _Place) -> str:
    count = len(place.near.speakers)
    return "the nearest feature" if count == 1 else f"the {count} nearest features"


# --- it stood --------------------------------------------------------------------------------


def _stood(place: _Place) -> _Judgement:
    p, residual = place.parameters, place.residual_px
    threshold = p.flow.residual_threshold_px
    least = threshold * place.depth / (place.camera.fx * place.dt)
    sentence = (
        f"It is static: the residual motion of {_speakers(place)} is {residual:.2f} px, below the "
        f"threshold of {threshold:g} px."
    )
    change = _if_it_counted(residual, p)
    if np.isfinite(least):
        faster = f"Anything moving sideways faster than {least:.2f} m/s here would count as motion"
        change = f"{faster}. {change}"
    return PixelVerdict.STATIC, sentence, change, {"least_speed_mps": known(least)}


def _if_it_counted(residual: float, p: Parameters) -> str:
    lowest, _ = limits(_THRESHOLD)
    value = below(residual)
    if float(value) < lowest:
        return (
            f"No value of {_THRESHOLD} would make it count as moving: its minimum is {lowest:g} px."
        )
    return (
        f"With {_THRESHOLD} at {value} px or below this would count as motion, and as an obstacle "
        f"if at least {p.clustering.min_points} such points are found together."
    )


# --- it moved --------------------------------------------------------------------------------


def _moved(place: _Place) -> _Judgement:
    motions: PointMotions = place.trace["motions"]
    around = np.flatnonzero(distances(motions.px_current, place.px) <= radius_px(place.camera))
    if len(around) == 0:
        return _not_measured(place)
    p = place.parameters
    labels = _groups(motions, p.clustering)
    ours = labels[around]
    if (ours < 0).all():
        return _too_small(place, motions, around)
    label = int(np.bincount(ours[ours >= 0]).argmax())
    group = _detections(motions, place, p.clustering)[label]
    numbers = _figures(group, p)
    needed = p.motion.min_significance
    if group.significance < needed:
        return (
            PixelVerdict.UNDECIDED,
            f"It may move, at {group.speed:.2f} m/s, but its {count_of(group.points, 'point')} "
            f"reach a significance of only {group.significance:.1f} σ, where {needed:g} σ is "
            "needed.",
            f"With motion.min_significance at {_at_most(group.significance)} or below it would "
            f"count as moving.",
            numbers,
        )
    return (
        PixelVerdict.DYNAMIC,
        f"It moves at {group.speed:.2f} m/s: the residual motion of {_speakers(place)} is "
        f"{place.residual_px:.2f} px, and the group of {count_of(group.points, 'point')} here has "
        f"a significance of {group.significance:.1f} σ.",
        _end_of_dynamic(place, group),
        numbers,
    )


def _not_measured(place: _Place) -> _Judgement:
    p, depth = place.parameters, place.depth
    seen = (
        f"Something moves: the residual motion of {_speakers(place)} is {place.residual_px:.2f} px"
    )
    if depth < p.stereo.min_depth_m:
        least, _ = limits("stereo.min_depth_m")
        value = below(depth)
        change = f"With stereo.min_depth_m at {value} m or below it would be measured."
        if float(value) < least:
            change = f"No setting allows that: the minimum of stereo.min_depth_m is {least:g} m."
        why = f"but it is {depth:.2f} m away, closer than {p.stereo.min_depth_m:g} m"
        return PixelVerdict.UNDECIDED, f"{seen}, {why}.", change, {}
    return (
        PixelVerdict.UNDECIDED,
        f"{seen}, but its depth is not known in both frames, or its speed exceeds "
        f"{p.motion.max_speed_mps:g} m/s, so it cannot be measured.",
        f"A value of stereo.uniqueness_percent below {p.stereo.uniqueness_percent}, a smaller "
        f"stereo.block_px or a larger stereo.max_disparity_px may give it a depth.",
        {},
    )


def _too_small(place: _Place, motions: PointMotions, around: np.ndarray[Any, Any]) -> _Judgement:
    p = place.parameters
    alone = p.clustering.model_copy(update={"min_points": 1})
    labels = _groups(motions, alone)
    sizes = np.bincount(labels)
    # The largest of the groups here needs the least change.
    label = int(max(labels[around], key=lambda each: sizes[each]))
    size = int(sizes[label])
    group = _detections(motions, place, alone)[label]
    also = ""
    if group.significance < p.motion.min_significance:
        also = f" and motion.min_significance at {_at_most(group.significance)} or below"
    return (
        PixelVerdict.UNDECIDED,
        f"Something moves, but with only {count_of(size, 'point')}, where an obstacle needs "
        f"{p.clustering.min_points}.",
        f"With clustering.min_points at {size} or below{also} it would count as moving.",
        _figures(group, p) | {"group_points": size},
    )


def _end_of_dynamic(place: _Place, group: Detection) -> str:
    """Return the nearest way to another answer."""
    p = place.parameters
    by_flow = place.residual_px / p.flow.residual_threshold_px
    by_significance = group.significance / max(p.motion.min_significance, 1e-9)
    ways = [
        (by_flow, _THRESHOLD, place.residual_px, " px", "it would count as static"),
        (
            by_significance,
            "motion.min_significance",
            group.significance,
            "",
            "it would not be significant enough to count",
        ),
    ]
    for _, name, value, unit, outcome in sorted(ways):
        if float(above(value)) <= limits(name)[1]:
            return f"With {name} at {above(value)}{unit} or above {outcome}."
    return "No single threshold would change it: its motion exceeds the range of each."


def _groups(motions: PointMotions, parameters: ClusteringParameters) -> np.ndarray[Any, Any]:
    """Return the number (K,) of each point's group, -1 = too small; as the method groups them."""
    return group_points(motions.points_camera, np.sqrt(motions.point_cov[:, 2, 2]), parameters)


def _detections(
    motions: PointMotions, place: _Place, clustering: ClusteringParameters
) -> tuple[Detection, ...]:
    """Return all groups as the method describes them, including insignificant ones."""
    motion: MotionParameters = place.parameters.motion.model_copy(update={"min_significance": 0.0})
    return detect_obstacles(motions, float(place.trace["time"]), clustering, motion)


def _figures(group: Detection, p: Parameters) -> dict[str, float | None]:
    return {
        "speed_mps": known(group.speed),
        "significance": known(group.significance),
        "min_significance": p.motion.min_significance,
        "group_points": group.points,
    }


def _at_most(value: float) -> str:
    """Round down to two decimals, so that ``value`` reaches the threshold."""
    return f"{np.floor(value * 100) / 100:.2f}"


def _too_far_words(depth: float, farthest: float) -> tuple[str, str]:
    """Return the sentence for a place beyond the maximum depth, and what would change it."""
    _, most = limits("stereo.max_depth_m")
    sentence = (
        f"It is too far: {depth:.1f} m away, and measurements are reliable enough only up to "
        f"{farthest:g} m."
    )
    if depth >= most:
        return (
            sentence,
            f"No setting allows that: the maximum of stereo.max_depth_m is {most:g} m.",
        )
    return sentence, f"With stereo.max_depth_m at {above(depth, 1)} m or above it would be tested."
