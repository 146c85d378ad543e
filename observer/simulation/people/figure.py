"""A person's figure: a skeleton in human proportions, clothed in ellipsoids.

Lengths are shares of the height after Drillis and Contini, "Body segment parameters", 1966.
Frame: the person's body frame, x forward, y left, z up, metres, the origin on the floor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from observer.geometry import Float64Array
from observer.simulation.people.ellipsoids import Ellipsoids
from observer.simulation.people.gait import Gait, Joints

Cloth = Literal["top", "trousers", "shoes", "skin", "hair"]

_THIGH, _SHANK, _ANKLE = 0.245, 0.246, 0.039
_UPPER_ARM, _FOREARM = 0.186, 0.146
_HIP_SIDE, _SHOULDER_SIDE, _SHOULDER_ABOVE = 0.052, 0.125, 0.288
_LEAN_RAD = 0.04


@dataclass(frozen=True)
class Limb:
    """One ellipsoid of the figure.

    Attributes:
        cloth: what it is made of.
        semi: semi-axes forward, sideways and along the bone; shares of the height, the first two
            for a person of average build.
        stout: whether it grows with the build.
        from_top: distance along the bone from the start of the cloth to the ellipsoid's centre,
            a share of the height. girth: of the cloth around the bone, likewise.
    """

    cloth: Cloth
    semi: tuple[float, float, float]
    stout: bool
    from_top: float
    girth: float


def _limb(
    cloth: Cloth,
    semi: tuple[float, float, float],
    from_top: float | None = None,
    girth: float | None = None,
    *,
    stout: bool = True,
) -> Limb:
    around = math.pi * (semi[0] + semi[1]) if girth is None else girth
    return Limb(cloth, semi, stout, semi[2] if from_top is None else from_top, around)


_TORSO_GIRTH = 0.52
# Limbs and their heights above the pelvis, in the order in which ``Figure`` places them.
_TRUNK = (
    (_limb("trousers", (0.074, 0.097, 0.085), 0.30, _TORSO_GIRTH), 0.02),
    (_limb("top", (0.068, 0.086, 0.11), 0.21, _TORSO_GIRTH), 0.10),
    (_limb("top", (0.070, 0.098, 0.12), 0.11, _TORSO_GIRTH), 0.20),
    (_limb("top", (0.046, 0.126, 0.048), 0.03, _TORSO_GIRTH), 0.285),
    (_limb("skin", (0.030, 0.030, 0.055), stout=False), 0.335),
    (_limb("skin", (0.056, 0.046, 0.070), stout=False), 0.405),
    (_limb("hair", (0.058, 0.050, 0.058), stout=False), 0.422),
)
_HAIR_BACK = 0.010
_SIDE = (
    _limb("trousers", (0.054, 0.052, 0.145)),
    _limb("trousers", (0.040, 0.038, 0.142)),
    _limb("shoes", (0.078, 0.028, 0.028), stout=False),
    _limb("top", (0.033, 0.032, 0.112)),
    _limb("top", (0.026, 0.026, 0.092)),
    _limb("skin", (0.016, 0.026, 0.048), stout=False),
)


class Figure:
    """A person's shape over time.

    Args:
        height: metres. girth: 1 for average build, less for a slim person.

    Attributes:
        limbs: in the order of ``shape``.
    """

    limbs: tuple[Limb, ...] = (*(limb for limb, _ in _TRUNK), *_SIDE, *_SIDE)

    def __init__(self, height: float, girth: float, gait: Gait) -> None:
        self.height = height
        self._gait = gait
        growth = np.array([[girth, girth, 1.0] if limb.stout else [1.0] * 3 for limb in self.limbs])
        self._semi = height * growth * np.array([limb.semi for limb in self.limbs])
        self.girths = tuple(
            height * limb.girth * (girth if limb.stout else 1.0) for limb in self.limbs
        )

    @staticmethod
    def leg_m(height: float) -> float:
        """Length of a leg from hip to ankle, metres."""
        return (_THIGH + _SHANK) * height

    def shape(self, time: float) -> Ellipsoids:
        """Return the ellipsoids at an instant."""
        sides = self._gait.joints(time)
        # The lower of the two feet is on the floor.
        pelvis = _ANKLE + max(
            _THIGH * math.cos(j.hip) + _SHANK * math.cos(j.hip - j.knee) for j in sides
        )
        centres, axes = self._trunk(pelvis)
        for joints, sign in zip(sides, (1.0, -1.0), strict=True):
            for centre, axis in (*_leg(joints, pelvis, sign), *_arm(joints, pelvis, sign)):
                centres.append(centre)
                axes.append(axis)
        return Ellipsoids(self.height * np.array(centres), np.array(axes), self._semi)

    def _trunk(self, pelvis: float) -> tuple[list[Float64Array], list[Float64Array]]:
        up = np.array([math.sin(_LEAN_RAD), 0.0, math.cos(_LEAN_RAD)])
        base = np.array([0.0, 0.0, pelvis])
        centres = [base + above * up for _, above in _TRUNK]
        centres[-1] = centres[-1] - np.array([_HAIR_BACK, 0.0, 0.0])
        return centres, [_frame(-up)] * len(_TRUNK)


def _bone(angle: float) -> Float64Array:
    return np.array([math.sin(angle), 0.0, -math.cos(angle)])


def _leg(joints: Joints, pelvis: float, sign: float) -> list[tuple[Float64Array, Float64Array]]:
    hip = np.array([0.0, sign * _HIP_SIDE, pelvis])
    thigh, shank = _bone(joints.hip), _bone(joints.hip - joints.knee)
    knee = hip + _THIGH * thigh
    ankle = knee + _SHANK * shank
    # The sole follows the shank as the leg swings, and is flat when the leg is nearly straight.
    pitch = 0.6 * min(0.0, joints.hip - joints.knee + 0.2)
    toes = np.array([math.cos(pitch), 0.0, math.sin(pitch)])
    foot = ankle + 0.042 * toes + np.array([0.0, 0.0, -0.012])
    return [
        (hip + _THIGH / 2 * thigh, _frame(thigh)),
        (knee + _SHANK / 2 * shank, _frame(shank)),
        (foot, _frame(np.array([toes[2], 0.0, -toes[0]]))),
    ]


def _arm(joints: Joints, pelvis: float, sign: float) -> list[tuple[Float64Array, Float64Array]]:
    shoulder = np.array([0.02, sign * _SHOULDER_SIDE, pelvis + _SHOULDER_ABOVE])
    upper = _sideways(_bone(joints.shoulder), sign * (joints.raised + 0.06))
    fore = _sideways(
        _bone(joints.shoulder + joints.elbow), sign * (joints.raised * 1.55 + joints.waved)
    )
    elbow = shoulder + _UPPER_ARM * upper
    wrist = elbow + _FOREARM * fore
    return [
        (shoulder + _UPPER_ARM / 2 * upper, _frame(upper)),
        (elbow + _FOREARM / 2 * fore, _frame(fore)),
        (wrist + 0.03 * fore, _frame(fore)),
    ]


def _sideways(bone: Float64Array, angle: float) -> Float64Array:
    """Turn a bone about the x axis, to the left by a positive angle."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([bone[0], c * bone[1] - s * bone[2], s * bone[1] + c * bone[2]])


def _frame(bone: Float64Array) -> Float64Array:
    """(3, 3) axes of an ellipsoid along a bone: x forward, y left, z opposite to the bone."""
    z = -bone / np.linalg.norm(bone)
    ahead = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.9 else np.array([0.0, 0.0, 1.0])
    y = np.cross(z, ahead)
    y /= np.linalg.norm(y)
    return np.column_stack([np.cross(y, z), y, z])
