"""How fast a programme wants its robots to drive at an instant: pure functions of elapsed time.

A programme is played as: its gesture, where it has one, once; then its rounds, one after another.
A round lasts as long as the longest of its robots' steps; a robot whose steps are over sooner
stands until the round ends. At the beginning of a round every robot counts as at rest.

``reverse`` drives every robot the same path in the other direction, so that it returns the way it
came: velocities are negated and time runs backwards, ``v(t) = -v'(D - t)`` with D the round's
duration. A robot drives backwards where it would have driven forward; it is not turned round. The
gesture is the same in both directions, it ends where it began anyway.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from observer.errors import InputError
from observer.motion_profiles.gesture import GESTURE_S, gesture_speed
from observer.motion_profiles.profile import Programme, Step
from observer.rig.rig import Role

MAX_REPEAT = 1000
Phase = Literal["gesture", "driving"]


@dataclass(frozen=True)
class Progress:
    """How far a programme is.

    Attributes:
        phase: what is driven. round: of ``repeat``, counted from 1; 1 in the gesture.
        elapsed_s, duration_s: of the whole.
    """

    phase: Phase
    round: int
    elapsed_s: float
    duration_s: float


def duration_s(programme: Programme, repeat: int = 1) -> float:
    """Seconds from the first pulse of the gesture to the end of the last round.

    Raises:
        InputError: ``repeat`` is not from 1 to ``MAX_REPEAT``.
    """
    _check_repeat(repeat)
    return _opening_s(programme) + repeat * round_s(programme)


def round_s(programme: Programme) -> float:
    """Seconds of one round, without the gesture."""
    return max(_total_s(steps) for steps in programme.steps.values())


def velocity_at(
    programme: Programme,
    role: Role,
    elapsed_s: float,
    *,
    repeat: int = 1,
    reverse: bool = False,
) -> tuple[float, float] | None:
    """What a robot shall drive so long after the programme's beginning.

    Args:
        elapsed_s: by a clock that never goes back; below 0 the robot stands.
        repeat: rounds. reverse: see the module.

    Returns:
        Speed forward in m/s and turn rate to the left in rad/s; None when the programme is over.
        A role that the programme does not move stands.

    Raises:
        InputError: ``repeat`` is not from 1 to ``MAX_REPEAT``.
    """
    # Also stops at an elapsed time that is no number.
    if not elapsed_s < duration_s(programme, repeat):
        return None
    steps = programme.steps.get(role, ())
    if elapsed_s < 0 or not steps:
        return 0.0, 0.0
    if elapsed_s < _opening_s(programme):
        return gesture_speed(elapsed_s), 0.0
    length = round_s(programme)
    within = math.fmod(elapsed_s - _opening_s(programme), length)
    if not reverse:
        return _sample(steps, within)
    speed, turn_rate = _sample(steps, length - within)
    # Without the sum, standing would be told as -0.0.
    return 0.0 - speed, 0.0 - turn_rate


def progress_at(programme: Programme, elapsed_s: float, repeat: int = 1) -> Progress:
    """How far it is so long after its beginning; before and after, as at its ends.

    Raises:
        InputError: ``repeat`` is not from 1 to ``MAX_REPEAT``.
    """
    whole = duration_s(programme, repeat)
    elapsed = min(max(elapsed_s, 0.0), whole)
    driven = elapsed - _opening_s(programme)
    if driven < 0:
        return Progress("gesture", 1, elapsed, whole)
    return Progress(
        "driving", min(repeat, 1 + math.floor(driven / round_s(programme))), elapsed, whole
    )


def _check_repeat(repeat: int) -> None:
    if not 1 <= repeat <= MAX_REPEAT:
        raise InputError(f"a programme is played 1 to {MAX_REPEAT} times, not {repeat}")


def _opening_s(programme: Programme) -> float:
    return GESTURE_S if programme.gesture else 0.0


def _total_s(steps: tuple[Step, ...]) -> float:
    return math.fsum(step.seconds for step in steps)


def _sample(steps: tuple[Step, ...], within_s: float) -> tuple[float, float]:
    """Of one round driven forward; within_s from 0 to the round's duration, both included."""
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
