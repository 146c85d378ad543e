"""The nine steps of the paper, each with its formula, its numbers and its parameters.

They are numbered as in the modules of ``observer.methods.planar`` and ``observer.vision``:
1 a rectified pair at t and at t+dt, 2 features, 3 matches, 4 the camera's own motion, 5 image
transformation, 6 residual optical flow, 7 stereo, 8 displacement over dt, 9 obstacles.
"""

from __future__ import annotations

from collections.abc import Callable

from observer.steps.image_steps import ego_motion_step, flow_step, warp_step
from observer.steps.matching_steps import features_step, images_step, matches_step
from observer.steps.pair import ObservedPair
from observer.steps.paper_step import PaperStep
from observer.steps.space_steps import displacement_step, obstacles_step, stereo_step

_STEPS: tuple[Callable[[ObservedPair], PaperStep], ...] = (
    images_step,
    features_step,
    matches_step,
    ego_motion_step,
    warp_step,
    flow_step,
    stereo_step,
    displacement_step,
    obstacles_step,
)
COUNT = len(_STEPS)


def one_step(pair: ObservedPair, number: int) -> PaperStep:
    """Return a step of an observed pair.

    Args:
        number: from 1.

    Raises:
        ValueError: there is no such step.
    """
    if not 1 <= number <= COUNT:
        raise ValueError(f"the method has steps 1 to {COUNT}, not {number}")
    return _STEPS[number - 1](pair)


def nine_steps(pair: ObservedPair) -> tuple[PaperStep, ...]:
    """Return all nine steps of an observed pair, in order."""
    return tuple(step(pair) for step in _STEPS)
