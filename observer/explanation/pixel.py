"""Explanation of a pixel: what is common to all methods, then the method's own reasons."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from observer.camera import StereoCamera, as_gray
from observer.explanation.answer import PixelAnswer, PixelVerdict, limits
from observer.explanation.monocular import explain_by_rays
from observer.explanation.planar import explain_by_flow
from observer.explanation.rigid import explain_by_evidence
from observer.parameters import Parameters
from observer.trace import TraceValues
from observer.types import Status


def explain_pixel(
    trace: TraceValues, camera: StereoCamera, parameters: Parameters, px: tuple[float, float]
) -> PixelAnswer:
    """Explain why the pixel counts as moving, as static, or as undecided.

    Args:
        trace: everything that one ``Observer.observe`` kept (see ``observer.observer``):
            ``evidence`` if evidence is gathered over time, otherwise residual flow.
        camera: the rectified pair. parameters: those used for the frame.
        px: u, v in the rectified left image of the frame, pixels; need not be whole.

    Raises:
        ValueError: ``px`` is not finite.
    """
    u, v = px = float(px[0]), float(px[1])
    if not np.isfinite(px).all():
        raise ValueError("a pixel's coordinates must be finite")
    if not (-0.5 <= u <= camera.width - 0.5 and -0.5 <= v <= camera.height - 0.5):
        return _outside(camera, px)
    ego = trace.get("ego_motion")
    if ego is None:
        return PixelAnswer(
            px,
            PixelVerdict.UNDECIDED,
            "There is no earlier frame to compare this one with, so motion is unknown.",
            {},
            "The next frame can be compared with this one.",
        )
    if ego.status is Status.LOST:
        return _lost(trace, parameters, px)
    counts = {"inliers": int(np.count_nonzero(ego.inliers)), "matches": len(ego.inliers)}
    if "ray_evidence" in trace:
        rays, evidence = trace["rays"], trace["ray_evidence"]
        return explain_by_rays(rays, evidence, camera, parameters, px, counts)
    if parameters.ego_motion.model == "monocular":
        return _not_started(ego.reasons, px, counts)
    if "evidence" in trace:
        left = trace.get("left")
        image = None if left is None else as_gray(left)
        evidence, unseen = trace["evidence"], trace.get("unseen")
        return explain_by_evidence(evidence, camera, parameters, px, counts, image, unseen)
    return explain_by_flow(trace, camera, parameters, px, counts)


def _not_started(
    reasons: tuple[str, ...], px: tuple[float, float], counts: Mapping[str, float]
) -> PixelAnswer:
    why = reasons[0] if reasons else "monocular depth needs translation"
    return PixelAnswer(
        px,
        PixelVerdict.UNDECIDED,
        f"Nothing can be decided here yet: {why}.",
        dict(counts),
        "It can be decided once the camera has moved on.",
    )


def _outside(camera: StereoCamera, px: tuple[float, float]) -> PixelAnswer:
    return PixelAnswer(
        px,
        PixelVerdict.OUTSIDE,
        f"The pixel {px[0]:g}, {px[1]:g} is outside the image of {camera.width} x "
        f"{camera.height} pixels.",
        {},
        f"Choose u from 0 to {camera.width - 1} and v from 0 to {camera.height - 1}.",
    )


def _lost(trace: TraceValues, parameters: Parameters, px: tuple[float, float]) -> PixelAnswer:
    ego, p = trace["ego_motion"], parameters.ego_motion
    count = len(ego.inliers)
    why = ego.reasons[0] if ego.reasons else "the reason is unknown"
    least, _ = limits("ego_motion.min_inliers")
    if least <= count < p.min_inliers:
        change = (
            f"With ego_motion.min_inliers at {count} or below (now {p.min_inliers}) these matches "
            "would be enough to try; more texture or light in the scene would give more."
        )
    elif count < least:
        change = (
            f"No setting can help: estimating the ego-motion needs at least {least:g} matches; "
            "more texture or light in the scene would give them."
        )
    else:
        change = (
            f"A value of ego_motion.min_inliers below {p.min_inliers}, or of "
            f"ego_motion.ransac_threshold_px above {p.ransac_threshold_px:g} px, may recover it."
        )
    return PixelAnswer(
        px,
        PixelVerdict.EGO_MOTION_LOST,
        f"The ego-motion is lost, so object motion cannot be separated from camera motion: {why}.",
        {"matches": count, "min_inliers": p.min_inliers},
        change,
    )
