"""Rotations as files write them: quaternions, rotation vectors ("helical") or Euler angles XYZ.

Vicon's three angles are one of the latter two. Tracker's default is helical, but its header says
"Global Angle" for both. Euler angles are bounded; helical ones exceed these bounds in large turns.
If they do not, the motion decides: a body that drives on the ground keeps one of its own axes
upright, and only the right reading shows that.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from observer.errors import TruthError
from observer.geometry import Float64Array, rotation_matrix
from observer.truth.files.known import AngleReading

# Files round quaternions to as few as three digits.
_UNIT_WITHIN = 1e-2

# Largest Euler angles XYZ, plus the rounding to six digits in files.
_EULER_LIMITS_RAD = np.array([math.pi, math.pi / 2, math.pi]) + 1e-3
# Degrees: readings that differ by less make no practical difference.
_SAME_DEG = 5.0
# With the right reading, a robot on a floor tilts by less than this ...
_UPRIGHT_DEG = 10.0
# ... and with the wrong one by at least this factor, and this many degrees, more.
_CLEAR_RATIO = 3.0
_CLEAR_MORE_DEG = 2.0
# A quantile instead of the maximum, since a single sample may be an outlier.
_SHARE = 0.99
# More samples would add no information.
_LOOKED_AT = 20_000


class AnglesUnclear(TruthError):
    """The angles can be read in two ways; only a person can say which is meant.

    Attributes:
        helical_tilt_deg, euler_xyz_tilt_deg: how far the bodies tilt in either reading.
    """

    def __init__(self, name: str, *, helical_tilt_deg: float, euler_xyz_tilt_deg: float) -> None:
        self.helical_tilt_deg = helical_tilt_deg
        self.euler_xyz_tilt_deg = euler_xyz_tilt_deg
        super().__init__(
            f"{name}: the angles may be helical (the bodies then tilt by up to "
            f"{helical_tilt_deg:.1f} deg) or Euler XYZ (by up to {euler_xyz_tilt_deg:.1f} deg); "
            "specify which was exported: helical or euler_xyz"
        )


def rotations(angles: Float64Array, reading: AngleReading) -> Float64Array:
    """Return ``R_room_body`` (N, 3, 3) of angles (N, 3) in radians; NaN where an angle is.

    Helical: the rotation vector. Euler XYZ: intrinsic, ``R = Rx(a) Ry(b) Rz(c)``.
    """
    if reading == "euler_xyz":
        return euler_rotations(angles, "XYZ")
    matrices = np.full((len(angles), 3, 3), np.nan)
    known = np.isfinite(angles).all(axis=1)
    if known.any():
        matrices[known] = rotation_matrix(angles[known])
    return matrices


def euler_rotations(angles: Float64Array, axes: str) -> Float64Array:
    """Return ``R_room_body`` (N, 3, 3) of Euler angles (N, 3) in radians; NaN where an angle is.

    Args:
        axes: capital letters of the body's own axes it is rotated about, in the order of the
            columns: ``R = Rz(a) Ry(b) Rx(c)`` for ``ZYX``.
    """
    matrices = np.full((len(angles), 3, 3), np.nan)
    known = np.isfinite(angles).all(axis=1)
    if known.any():
        turned = scipy.spatial.transform.Rotation.from_euler(axes, angles[known])
        matrices[known] = turned.as_matrix()
    return matrices


def quaternion_rotations(xyzw: Float64Array) -> tuple[Float64Array, NDArray[np.bool_]]:
    """Return ``R_room_body`` (N, 3, 3) of quaternions (N, 4), scalar last; NaN where a number is.

    The second array (N,) marks rows without NaN that are not unit quaternions; their rotations are
    NaN, too.
    """
    matrices = np.full((len(xyzw), 3, 3), np.nan)
    known = np.isfinite(xyzw).all(axis=1)
    with np.errstate(over="ignore"):
        lengths = np.sqrt((xyzw * xyzw).sum(axis=1))
    unit = known & (np.abs(lengths - 1) <= _UNIT_WITHIN)
    if unit.any():
        matrices[unit] = scipy.spatial.transform.Rotation.from_quat(xyzw[unit]).as_matrix()
    return matrices, np.asarray(known & ~unit)


def find_reading(name: str, bodies: Mapping[str, Float64Array]) -> tuple[AngleReading, str]:
    """Find the reading of all bodies' angles (N, 3) in radians, NaN in gaps.

    Args:
        name: the file's, for messages.

    Returns:
        The reading, and one sentence that says why.

    Raises:
        AnglesUnclear: both readings are possible, and they differ.
    """
    some = {body: _some(angles) for body, angles in bodies.items()}
    some = {body: angles for body, angles in some.items() if len(angles)}
    for body, angles in some.items():
        if (np.abs(angles) > _EULER_LIMITS_RAD).any():
            most = float(np.linalg.norm(angles, axis=1).max())
            return "helical", (
                f"angles are helical (rotation vectors): those of {body} reach {most:.2f} rad, "
                "which Euler angles cannot"
            )
    # If a body hardly turns, the readings differ by a constant rotation, which nothing reveals.
    readings = [r for r in map(_Readings.of, some.values()) if r.turned_deg > _SAME_DEG]
    usual = "angles are read as helical (rotation vectors), which is Tracker's default"
    if some and not readings:
        return "helical", f"{usual}; no body turns enough to distinguish them from Euler angles XYZ"
    helical = max((r.helical_tilt_deg for r in readings), default=0.0)
    euler = max((r.euler_tilt_deg for r in readings), default=0.0)
    votes = {r.vote for r in readings if r.vote is not None}
    if votes == {"helical"}:
        return "helical", (
            "angles are helical (rotation vectors): read this way the bodies tilt by at most "
            f"{helical:.1f} deg, as Euler angles XYZ by {euler:.1f} deg"
        )
    if votes == {"euler_xyz"}:
        return "euler_xyz", (
            f"angles are Euler angles XYZ: read this way the bodies tilt by at most {euler:.1f} "
            f"deg, as helical angles by {helical:.1f} deg"
        )
    if not votes and all(r.differ_deg <= _SAME_DEG for r in readings):
        most = max((r.differ_deg for r in readings), default=0.0)
        why = f"{usual}; Euler angles XYZ would differ by at most {most:.1f} deg"
        return "helical", why
    raise AnglesUnclear(name, helical_tilt_deg=helical, euler_xyz_tilt_deg=euler)


@dataclass(frozen=True)
class _Readings:
    """Tilts and turns of a body in both readings of its angles, degrees."""

    helical_tilt_deg: float
    euler_tilt_deg: float
    differ_deg: float
    turned_deg: float

    @staticmethod
    def of(angles: Float64Array) -> _Readings:
        helical, euler = rotations(angles, "helical"), rotations(angles, "euler_xyz")
        return _Readings(
            _tilt_deg(helical),
            _tilt_deg(euler),
            _largest_between_deg(helical, euler),
            _largest_between_deg(helical, helical[:1]),
        )

    @property
    def vote(self) -> AngleReading | None:
        """The reading that keeps the body upright, if the other one does not."""
        lower, higher = sorted((self.helical_tilt_deg, self.euler_tilt_deg))
        if lower > _UPRIGHT_DEG or higher < max(_CLEAR_RATIO * lower, lower + _CLEAR_MORE_DEG):
            return None
        return "helical" if lower == self.helical_tilt_deg else "euler_xyz"


def _some(angles: Float64Array) -> Float64Array:
    known = angles[np.isfinite(angles).all(axis=1)]
    return known[:: max(1, len(known) // _LOOKED_AT)]


def _tilt_deg(R_room_body: Float64Array) -> float:
    """Return the largest angle from the vertical of the body's mean upright direction, degrees."""
    # The room's z axis in the body frame.
    up = R_room_body[:, 2, :]
    mean = up.mean(axis=0)
    length = float(np.linalg.norm(mean))
    return 180.0 if length < 1e-9 else _largest_deg(up @ (mean / length))


def _largest_between_deg(a: Float64Array, b: Float64Array) -> float:
    """Return the largest angle between rotations (N, 3, 3), degrees."""
    # The trace of the rotation from a to b is 1 + 2 cos(angle).
    return _largest_deg(((a * b).sum(axis=(1, 2)) - 1) / 2)


def _largest_deg(cosines: Float64Array) -> float:
    angles = np.arccos(np.clip(cosines, -1, 1))
    return math.degrees(float(np.quantile(angles, _SHARE)))
