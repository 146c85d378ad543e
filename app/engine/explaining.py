"""Explanation of a pixel's class in the newest frame, and of the camera's own motion."""

from __future__ import annotations

from app.contract.pixel import Pixel, PixelObstacle
from app.contract.status import CameraMotion, Decomposition, EgoMotionStatus
from app.contract.values import word
from app.engine.errors import NotNow
from app.engine.observed import Observed
from observer.errors import InputError
from observer.explanation import PixelAnswer, PixelVerdict, explain_pixel
from observer.explanation.answer import known
from observer.parameters import Parameters
from observer.trace import TraceValues
from observer.types import Obstacle, TrackState


def explain(observed: Observed | None, u: float, v: float) -> Pixel:
    """Explain how a pixel of the newest observed frame was classified.

    Raises:
        NotNow: no frame was observed yet.
        InputError: the pixel is outside the image.
    """
    if observed is None:
        raise NotNow("no frame has been observed yet; open a source and wait for its first frame")
    answer = explain_pixel(observed.trace, observed.camera, observed.parameters, (u, v))
    if answer.verdict is PixelVerdict.OUTSIDE:
        raise InputError(f"{answer.sentence} {answer.would_change}")
    obstacle = _obstacle_at(answer, observed.observation.obstacles)
    return Pixel(
        frame=observed.frame.index,
        segment=observed.segment,
        u=answer.px[0],
        v=answer.px[1],
        verdict=word(answer.verdict),
        sentence=answer.sentence,
        numbers=dict(answer.numbers),
        would_change=answer.would_change,
        obstacle=None
        if obstacle is None
        else PixelObstacle(
            obstacle.id, obstacle.state is not TrackState.TENTATIVE, obstacle.reason
        ),
    )


def _obstacle_at(answer: PixelAnswer, obstacles: tuple[Obstacle, ...]) -> Obstacle | None:
    """Return the nearest obstacle seen at a dynamic pixel."""
    if answer.verdict is not PixelVerdict.DYNAMIC:
        return None
    # Boxes end at the outermost features; pixels close to a feature belong to it.
    reach = answer.numbers.get("nearest_feature_px") or 0.0
    u, v = answer.px
    here = [
        o
        for o in obstacles
        if o.state is not TrackState.COASTING
        and o.box_px[0] - reach <= u <= o.box_px[2] + reach
        and o.box_px[1] - reach <= v <= o.box_px[3] + reach
    ]
    return min(here, key=lambda o: o.range, default=None)


def ego_motion_facts(trace: TraceValues, parameters: Parameters) -> EgoMotionStatus | None:
    """Return the camera's motion between frames as ``ObservationEvent.ego_motion`` holds it."""
    ego = trace.get("ego_motion")
    if ego is None:
        return None
    parts, pose = trace.get("decomposition"), ego.T_current_previous
    dt = trace["time"] - trace["previous_time"] if "previous_time" in trace else None
    return EgoMotionStatus(
        model=parameters.ego_motion.model,
        status=word(ego.status),
        matches=len(ego.inliers),
        inliers=int(ego.inliers.sum()),
        dt=dt,
        decomposition=None
        if parts is None
        else Decomposition(
            translation_px=[float(c) for c in parts["translation_px"]],
            rotation_rad=float(parts["rotation_rad"]),
            shear=known(parts["shear"]),
            scale=[float(c) for c in parts["scale"]],
        ),
        # The camera's motion, in its own axes at t: the inverse of the points' apparent motion.
        motion=None
        if pose is None
        else CameraMotion(pose.inverse().rotvec.tolist(), pose.inverse().translation.tolist()),
    )
