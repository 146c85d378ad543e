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
# Seconds: sampling interval of the gait's phase, and by how much it is extended at a time.
_DISTANCE_STEP_S = 0.02
_EXTENSION_S = 10.0


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
        duration_s: of the scenario. Until 60 s after its end the gait's phase is computed in
            advance, later on demand.
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
        self._cycles = self._extended(np.zeros(1), duration_s + 60.0)

    def _extended(self, cycles: Float64Array, seconds: float) -> Float64Array:
        """Continue ``cycles``: gait cycles of two steps, completed at multiples of the interval.

        They are added up one by one, so that the result does not depend on where it is extended.
        """
        first = len(cycles) - 1
        numbers = np.arange(first, first + math.ceil(seconds / _DISTANCE_STEP_S))
        speeds = np.array([self._speed(t) for t in (numbers * _DISTANCE_STEP_S).tolist()])
        steps = np.maximum(self._step_m(speeds), 1e-3)
        more = speeds * _DISTANCE_STEP_S / (2 * steps)
        return np.concatenate([cycles[:-1], np.cumsum(np.concatenate([cycles[-1:], more]))])

    def _cycles_at(self, time: float) -> float:
        cycles = self._cycles
        while time >= (len(cycles) - 1) * _DISTANCE_STEP_S:
            # Other threads may do the same at the same time, with the same result.
            cycles = self._cycles = self._extended(cycles, _EXTENSION_S)
        k = int(max(0.0, time) / _DISTANCE_STEP_S)
        # One more to each side, in case the division is rounded over a sample.
        near = np.arange(max(0, k - 1), min(k + 3, len(cycles)))
        return float(np.interp(time, near * _DISTANCE_STEP_S, cycles[near]))

    def _speed(self, time: float) -> float:
        state = self._motion.state(time)
        return math.hypot(state.vx, state.vy)

    def _step_m(self, speed: Float64Array) -> Float64Array:
        share = _STEP_AT_WALKING * np.sqrt(np.maximum(speed, 0.05) / _WALKING_MPS)
        return np.asarray(share * self._height)

    def joints(self, time: float) -> tuple[Joints, Joints]:
        """Return the joint angles of the left and the right side."""
        phase = 2 * math.pi * self._cycles_at(time)
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
