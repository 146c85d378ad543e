"""The start-stop gesture at the beginning of a motion profile, used later to align clocks.

Four short pulses, alternately forward and back, begin at 0, 2, 5 and 9 times 0.5 s. These marks are
a Golomb ruler: every difference between two of them occurs once. So the pattern, shifted against
itself by a non-zero offset, matches in at most one of its four pulses: its autocorrelation has one
peak of 4 and otherwise never exceeds 1, with or without the signs of the speed. Cross-correlating
two records of the speed (commanded, encoders, motion capture, vision) therefore has one clear
maximum, at the offset of their clocks (Golomb rulers and their
autocorrelation: Dimitromanolakis, Analysis of the Golomb ruler and the Sidon set problems, 2002).

No two marks are adjacent, so all pulses are alike, and a robot that accelerates slowly travels
equally far in each of them: it ends where it began and is never more than one pulse ahead.
"""

from __future__ import annotations

GESTURE_SPEED_MPS = 0.15
PULSE_S = 0.5
# In pulse lengths from the beginning: forward, back, forward, back.
PULSE_STARTS = (0, 2, 5, 9)
# Seconds: then the robot stands, so that the last pulse ends before the rounds on every clock.
REST_S = 1.0
GESTURE_S = (PULSE_STARTS[-1] + 1) * PULSE_S + REST_S


def gesture_speed(elapsed_s: float) -> float:
    """Return the speed in m/s at ``elapsed_s`` of the gesture; 0 before and after it."""
    for number, start in enumerate(PULSE_STARTS):
        if start * PULSE_S <= elapsed_s < (start + 1) * PULSE_S:
            return GESTURE_SPEED_MPS if number % 2 == 0 else -GESTURE_SPEED_MPS
    return 0.0
