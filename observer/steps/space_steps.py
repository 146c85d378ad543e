"""Steps 7 to 9: where obstacles are, and how fast."""

from __future__ import annotations

import numpy as np

from observer.intervals import half_95
from observer.steps.formulas import (
    frac,
    gap,
    row,
    size,
    sub,
    under,
    words,
)
from observer.steps.pair import ObservedPair
from observer.steps.paper_step import Number, PaperStep, known_median, lost
from observer.types import Obstacle
from observer.vision.stereo import sample_disparity


def stereo_step(pair: ObservedPair) -> PaperStep:
    """Return step 7: disparity and position."""
    trace, camera = pair.trace, pair.camera
    disparity = trace["disparity"]
    numbers = [
        Number("Pixels with a disparity", 100 * float(np.isfinite(disparity).mean()), "%", 1),
        Number("f b", camera.fb, "px m", 2),
    ]
    if "motions" in trace:
        count = len(trace["motions"].points_previous)
        depth = known_median(trace["motions"].points_previous[:, 2])
        found = sample_disparity(disparity, trace["flow_px"][trace["dynamic"]])
        numbers += [
            Number("Dynamic points with a position", count),
            Number("Their median disparity", known_median(found[np.isfinite(found)]), "px", 1),
            Number("Their median depth", depth, "m", 2),
        ]
    return PaperStep(
        7,
        "stereo",
        "Stereo: disparity and position",
        "The disparity d is how much further left a point lies in the right image. With the focal "
        "length f and the baseline b it gives the depth Z, and with the pixel the position.",
        "Colour: disparity; red is near, dark is unknown. Red points: dynamic.",
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


def displacement_step(pair: ObservedPair) -> PaperStep:
    """Return step 8: displacement over dt."""
    numbers: tuple[Number, ...] = ()
    if "motions" in pair.trace:
        motions = pair.trace["motions"]
        moved_m = np.linalg.norm(motions.points_current - motions.points_previous, axis=1)
        speed = np.linalg.norm(motions.velocity, axis=1)
        numbers = (
            Number("Points", len(moved_m)),
            Number("dt", pair.dt, "s", 3),
            Number("Median displacement", known_median(1000 * moved_m), "mm", 0),
            Number("Median speed of a point", known_median(speed), "m/s", 2),
        )
    return PaperStep(
        8,
        "displacement",
        "Displacement over dt",
        "Both clouds have the camera at t as their origin, so a static point P has the same "
        "position in both. The displacement of a dynamic point, divided by dt, is its velocity v.",
        "From above. Red: an arrow from each dynamic point, as long as its motion in one second.",
        row("v =", frac(row(sub("P", "t+dt"), "−", sub("P", "t")), "dt")),
        numbers,
        (
            "motion.max_speed_mps",
            "motion.disparity_sigma_px",
            "motion.pixel_sigma_px",
            "stereo.min_depth_m",
            "stereo.max_depth_m",
        ),
        lost(pair),
    )


def obstacles_step(pair: ObservedPair) -> PaperStep:
    """Return step 9: obstacles with speed and identity."""
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
        "Dynamic points closer together than r form one obstacle; its speed is the magnitude of "
        "their mean velocity. It is reported once it has been seen in several frames.",
        "Red: obstacles with their speed. Green stars: their points. White, dashed: too new to "
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
        lost(pair),
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
