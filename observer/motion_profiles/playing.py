"""Velocities of a motion profile at an instant: pure functions of elapsed time.

Playing a profile means its gesture, if it has one, then its rounds, one after another. A round
lasts as long as the longest of its robots' step sequences; a robot whose steps end sooner stands
until the round ends. Every robot starts a round from rest.

``reverse`` drives every robot back along its path: velocities are negated and time runs backwards,
``v(t) = -v'(D - t)`` with D the round's duration. The robot is not turned around; it drives
backwards where it would have driven forward. The gesture ends where it began and is not reversed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from observer.errors import InputError
from observer.motion_profiles.gesture import GESTURE_S, gesture_speed
from observer.motion_profiles.profile import MotionProfile, Step
from observer.rig.rig import Role

MAX_REPEAT = 1000
Phase = Literal["gesture", "driving"]


@dataclass(frozen=True)
class Progress:
    """Progress of a motion profile.

    Attributes:
        round: number out of ``repeat``, counted from 1; 1 during the gesture.
        elapsed_s, duration_s: of the whole profile.
    """

    phase: Phase
    round: int
    elapsed_s: float
    duration_s: float


def duration_s(profile: MotionProfile, repeat: int = 1) -> float:
    """Return the seconds from the first pulse of the gesture to the end of the last round.

    Raises:
        InputError: ``repeat`` is not from 1 to ``MAX_REPEAT``.
    """
    if not 1 <= repeat <= MAX_REPEAT:
        raise InputError(f"a programme can be repeated 1 to {MAX_REPEAT} times, not {repeat}")
    return _opening_s(profile) + repeat * round_s(profile)


def round_s(profile: MotionProfile) -> float:
    """Return the seconds of one round, without the gesture."""
    return max(math.fsum(step.seconds for step in steps) for steps in profile.steps.values())


def velocity_at(
    profile: MotionProfile, role: Role, elapsed_s: float, *, repeat: int = 1, reverse: bool = False
) -> tuple[float, float] | None:
    """Return the velocity that a robot is to drive at ``elapsed_s`` of the profile.

    Args:
        elapsed_s: from a monotonic clock; below 0 the robot stands.
        repeat: number of rounds. reverse: see the module.

    Returns:
        Speed forward in m/s and turn rate to the left in rad/s; None once the profile
        is over. A role that the profile does not move stands.

    Raises:
        InputError: ``repeat`` is not from 1 to ``MAX_REPEAT``.
    """
    # Negated so that NaN also ends it.
    if not elapsed_s < duration_s(profile, repeat):
        return None
    steps = profile.steps.get(role, ())
    if elapsed_s < 0 or not steps:
        return 0.0, 0.0
    if elapsed_s < _opening_s(profile):
        return gesture_speed(elapsed_s), 0.0
    length = round_s(profile)
    within = math.fmod(elapsed_s - _opening_s(profile), length)
    if not reverse:
        return _sample(steps, within)
    speed, turn_rate = _sample(steps, length - within)
    # Subtract instead of negating, so that standstill is 0.0 and not -0.0.
    return 0.0 - speed, 0.0 - turn_rate


def progress_at(profile: MotionProfile, elapsed_s: float, repeat: int = 1) -> Progress:
    """Return the progress at ``elapsed_s``, clamped to the beginning and the end.

    Raises:
        InputError: ``repeat`` is not from 1 to ``MAX_REPEAT``.
    """
    whole = duration_s(profile, repeat)
    elapsed = min(max(elapsed_s, 0.0), whole)
    driven = elapsed - _opening_s(profile)
    if driven < 0:
        return Progress("gesture", 1, elapsed, whole)
    return Progress(
        "driving", min(repeat, 1 + math.floor(driven / round_s(profile))), elapsed, whole
    )


def _opening_s(profile: MotionProfile) -> float:
    return GESTURE_S if profile.gesture else 0.0


def _sample(steps: tuple[Step, ...], within_s: float) -> tuple[float, float]:
    """Sample one round driven forward; ``within_s`` from 0 to its duration, both included."""
    before = (0.0, 0.0)
    start = 0.0
    for step in steps:
        wanted = (step.speed_mps, step.turn_rate_radps)
        share = (within_s - start) / step.seconds
        if share < 1:
            if not step.ramp:
                return wanted
            return (
                before[0] + share * (wanted[0] - before[0]),
                before[1] + share * (wanted[1] - before[1]),
            )
        before = wanted
        start += step.seconds
    return 0.0, 0.0
