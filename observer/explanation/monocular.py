"""Reasons of the monocular method."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from observer.camera import StereoCamera
from observer.explanation.answer import PixelAnswer, PixelVerdict, known, look_around
from observer.methods.monocular.motion_test import RayEvidence
from observer.methods.monocular.rays import RayPoints
from observer.number_format import count_of
from observer.parameters import Parameters
from observer.vision.lifecycle import NO_OBSTACLE

_RATE = "evidence.false_alarms_per_frame"


def explain_by_rays(
    points: RayPoints,
    evidence: RayEvidence,
    camera: StereoCamera,
    parameters: Parameters,
    px: tuple[float, float],
    counts: Mapping[str, float],
) -> PixelAnswer:
    """Return the answer of the majority of the nearest points.

    Args:
        counts: figures of the camera's own motion, shown with the answer's.
    """
    near = look_around(points.px, px, camera)
    if len(near.members) == 0:
        return PixelAnswer(
            px,
            PixelVerdict.TOO_FEW_FEATURES,
            f"No point is tracked within {near.radius_px:.0f} px of here.",
            near.numbers | dict(counts),
            "More texture or light here would give points to track.",
        )
    chosen = near.speakers
    moves = evidence.moving[chosen] | (points.obstacle[chosen] != NO_OBSTACLE)
    moving = int(np.count_nonzero(moves)) * 2 > len(chosen)
    middle = float(np.median(evidence.significance[chosen]))
    speaker = int(chosen[0])
    inverse = float(points.inverse[speaker])
    distance = 1 / inverse if points.known[speaker] else float("nan")
    numbers = near.numbers | {
        "depth_m": known(distance),
        "age_s": known(float(points.age_s[speaker])),
        "significance": known(middle),
        "threshold": known(evidence.threshold),
        "neighbours": int(evidence.neighbours[speaker]),
    }
    verdict, sentence, change = _judge(moving, middle, evidence.threshold, distance, parameters)
    return PixelAnswer(px, verdict, sentence, numbers | dict(counts), change)


def _judge(
    moving: bool, middle: float, threshold: float, distance: float, parameters: Parameters
) -> tuple[PixelVerdict, str, str]:
    significance = f"{middle:.1f} σ, where {threshold:.1f} σ is needed"
    rate = f"{_RATE} (now {parameters.evidence.false_alarms_per_frame:g})"
    if moving:
        return (
            PixelVerdict.DYNAMIC,
            "It moves: the points here do not stay on the epipolar lines of static points "
            f"({significance}).",
            f"A lower {rate} would require more evidence.",
        )
    if not np.isfinite(distance):
        return (
            PixelVerdict.UNDECIDED,
            "The points here have no depth yet: monocular depth needs translation.",
            "It can be decided once the camera has moved on, across the line of sight to this "
            "place.",
        )
    return (
        PixelVerdict.STATIC,
        f"It is static, {distance:.1f} m away: the apparent motion is noise ({significance}).",
        f"A higher {rate} would require less evidence; motion straight along the line of sight "
        f"may remain invisible to {count_of(1, 'camera')}.",
    )
