"""Joint angles of a person who walks, stands, waves or carries something.

Angles are radians in the sagittal plane, positive forwards; a bone at angle t hangs along
(sin t, 0, -cos t) of the body's frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from observer.geometry import Float64Array
from observer.simulation.motion import PlanarMotion

# Step length at 1.4 m/s as a share of the person's height; it grows with the square root of the
# speed, as measured in walking people (Grieve and Gear, 1966).
_STEP_AT_WALKING = 0.43
_WALKING_MPS = 1.4
# Radians: knee flexion in the stance phase and at mid-swing.
_KNEE_STANDING = 0.08
_KNEE_SWINGING = 0.95
# Arms swing by this share of the legs' angle, with elbows slightly bent.
_ARM_SWING = 0.75
_ELBOW = 0.25
# m/s: below this speed walking fades into standing.
_STANDING_MPS = 0.15
# Frequency of a waving hand, and its amplitude to each side.
_WAVE_HZ = 0.9
_WAVE_RAD = 0.6
# Seconds: sampling interval of the gait's phase.
_DISTANCE_STEP_S = 0.02


@dataclass(frozen=True)
class Joints:
    """Angles of one side's limbs.

    Attributes:
        hip, knee, shoulder, elbow: knees bend backwards and elbows forwards, both positive.
        raised: of the upper arm, sideways. waved: of the forearm, sideways.
    """

    hip: float
    knee: float
    shoulder: float
    elbow: float
    raised: float = 0.0
    waved: float = 0.0


class Gait:
    """Joint angles of one person over time; steps follow the distance walked.

    Args:
        height: of the person, metres. swing: of the arms, 1 is normal.
        gesture: ``walk``, ``wave`` (the right hand, whether walking or not) or ``carry`` (both
            hands before the belly).
        duration_s: of the scenario; the gait's phase is known until 60 s after its end.
    """

    def __init__(
        self,
        motion: PlanarMotion,
        height: float,
        leg_m: float,
        gesture: str,
        swing: float,
        duration_s: float,
    ) -> None:
        self._motion = motion
        self._height = height
        self._leg = leg_m
        self._gesture = gesture
        self._swing = swing
        times = np.arange(0.0, duration_s + 60.0, _DISTANCE_STEP_S)
        speeds = np.array([self._speed(t) for t in times.tolist()])
        steps = np.maximum(self._step_m(speeds), 1e-3)
        self._times = times
        # Number of gait cycles, two steps each, completed by each instant.
        self._cycles = np.concatenate(
            [[0.0], np.cumsum(speeds[:-1] * _DISTANCE_STEP_S / (2 * steps[:-1]))]
        )

    def _speed(self, time: float) -> float:
        state = self._motion.state(time)
        return math.hypot(state.vx, state.vy)

    def _step_m(self, speed: Float64Array) -> Float64Array:
        share = _STEP_AT_WALKING * np.sqrt(np.maximum(speed, 0.05) / _WALKING_MPS)
        return np.asarray(share * self._height)

    def joints(self, time: float) -> tuple[Joints, Joints]:
        """Return the joint angles of the left and the right side."""
        phase = 2 * math.pi * float(np.interp(time, self._times, self._cycles))
        speed = self._speed(time)
        walking = min(1.0, speed / _STANDING_MPS)
        step = float(self._step_m(np.array([speed]))[0])
        stride = walking * math.asin(min(0.9, step / (2 * self._leg)))
        return self._side(phase, stride, walking, time, left=True), self._side(
            phase + math.pi, stride, walking, time, left=False
        )

    def _side(
        self, phase: float, stride: float, walking: float, time: float, *, left: bool
    ) -> Joints:
        # Nearly a triangle wave, so that a foot on the floor stays put while the body moves on.
        hip = stride * 2 / math.pi * math.asin(0.97 * math.sin(phase))
        swinging = max(0.0, math.cos(phase))
        knee = walking * (_KNEE_STANDING + _KNEE_SWINGING * swinging**2 * min(1.0, stride / 0.4))
        shoulder = -_ARM_SWING * self._swing * stride * math.sin(phase)
        if self._gesture == "carry":
            return Joints(hip, knee, 0.35, 1.2)
        if self._gesture == "wave" and not left:
            wave = _WAVE_RAD * math.sin(2 * math.pi * _WAVE_HZ * time)
            return Joints(hip, knee, 0.1, 0.0, raised=1.9, waved=wave)
        return Joints(hip, knee, shoulder, _ELBOW * (0.3 + walking))
