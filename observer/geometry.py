"""Rigid motions and rotations, in the naming used throughout: ``T_target_source``.

``T_a_b`` maps coordinates given in frame b to coordinates in frame a:
``p_a = T_a_b.apply(p_b)``, so ``T_a_c = T_a_b @ T_b_c``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64Array = NDArray[np.float64]

# Corners (8, 3) of a box in units of its half size.
BOX_CORNERS = np.array(
    [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64
)

# A rotation matrix read from text with 7 digits is orthonormal to about 1e-6.
_ROTATION_TOLERANCE = 1e-4
# Below this angle, rad, sine and cosine are replaced by the first terms of their series.
_SMALL_ANGLE = 1e-4


@dataclass(frozen=True, eq=False)
class Pose:
    """A rigid motion ``T_target_source``.

    Attributes:
        rotation: (3, 3) float64, orthonormal, determinant +1.
        translation: (3,) float64, metres: the source frame's origin in the target frame.

    Raises:
        ValueError: the shapes are wrong, a number is not finite or the matrix is not a rotation.
    """

    rotation: Float64Array
    translation: Float64Array

    def __post_init__(self) -> None:
        rotation = np.array(self.rotation, dtype=np.float64)
        translation = np.array(self.translation, dtype=np.float64).reshape(-1)
        if rotation.shape != (3, 3) or translation.shape != (3,):
            raise ValueError(
                f"a pose needs a (3, 3) rotation and a (3,) translation, "
                f"not {rotation.shape} and {translation.shape}"
            )
        if not (all(map(math.isfinite, rotation.flat)) and all(map(math.isfinite, translation))):
            raise ValueError("a pose must be finite")
        if not is_rotation(rotation):
            raise ValueError("the 3x3 matrix of a pose must be a rotation (R^T R = I, det R = +1)")
        rotation.setflags(write=False)
        translation.setflags(write=False)
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "translation", translation)

    @staticmethod
    def _trusted(rotation: Float64Array, translation: Float64Array) -> Pose:
        """Make a pose, without checks, of new float64 arrays (3, 3), (3,) computed from poses.

        The checks cost more than the computation, and poses are made dozens of times per frame.
        """
        rotation.setflags(write=False)
        translation.setflags(write=False)
        pose = object.__new__(Pose)
        object.__setattr__(pose, "rotation", rotation)
        object.__setattr__(pose, "translation", translation)
        return pose

    @staticmethod
    def identity() -> Pose:
        return Pose(np.eye(3), np.zeros(3))

    @staticmethod
    def from_matrix(matrix: ArrayLike) -> Pose:
        """Make a pose from a (3, 4) or (4, 4) homogeneous matrix, metres.

        Raises:
            ValueError: the matrix has another shape, or no rotation.
        """
        m = np.asarray(matrix, dtype=np.float64)
        if m.shape not in ((3, 4), (4, 4)):
            raise ValueError(f"a pose matrix must be (3, 4) or (4, 4), not {m.shape}")
        return Pose(m[:3, :3], m[:3, 3])

    @staticmethod
    def from_rotvec(rotvec: ArrayLike, translation: ArrayLike) -> Pose:
        """Make a pose from a rotation vector (3,), radians, and a translation (3,), metres."""
        x, y, z = np.asarray(rotvec, dtype=np.float64).reshape(3).tolist()
        angle = math.sqrt(x * x + y * y + z * z)
        scale = math.sin(angle / 2) / angle if angle > _SMALL_ANGLE else 0.5 - angle * angle / 48
        wxyz = (math.cos(angle / 2), scale * x, scale * y, scale * z)
        return Pose.from_quaternion(wxyz, translation)

    @staticmethod
    def from_quaternion(wxyz: ArrayLike, translation: ArrayLike) -> Pose:
        """Make a pose from a quaternion (4,), scalar first, and a translation (3,), metres.

        Raises:
            ValueError: the quaternion is zero.
        """
        w, x, y, z = np.asarray(wxyz, dtype=np.float64).reshape(4).tolist()
        square = w * w + x * x + y * y + z * z
        if not square > 0:
            raise ValueError("a quaternion must not be zero")
        s = 2 / square
        rotation = [
            [1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
            [s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)],
            [s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)],
        ]
        return Pose(np.array(rotation), np.asarray(translation, dtype=np.float64).reshape(3))

    @property
    def matrix(self) -> Float64Array:
        """(4, 4) homogeneous matrix."""
        m = np.eye(4)
        m[:3, :3] = self.rotation
        m[:3, 3] = self.translation
        return m

    @property
    def quaternion_wxyz(self) -> Float64Array:
        """(4,) unit quaternion, scalar first and not negative."""
        return np.array(_quaternion(self.rotation))

    @property
    def rotvec(self) -> Float64Array:
        """(3,) rotation vector in radians."""
        w, x, y, z = _quaternion(self.rotation)
        sine = math.sqrt(x * x + y * y + z * z)
        # ``sine`` is that of half the angle; for small angles the angle is twice the sine.
        scale = 2 * math.atan2(sine, w) / sine if sine > _SMALL_ANGLE**2 else 2.0
        return np.array([scale * x, scale * y, scale * z])

    def apply(self, points: ArrayLike) -> Float64Array:
        """Map points (..., 3) from the source frame into the target frame."""
        p = np.asarray(points, dtype=np.float64)
        return np.asarray(p @ self.rotation.T + self.translation, dtype=np.float64)

    def rotate(self, vectors: ArrayLike) -> Float64Array:
        """Rotate free vectors (..., 3), such as velocities, into the target frame."""
        v = np.asarray(vectors, dtype=np.float64)
        return np.asarray(v @ self.rotation.T, dtype=np.float64)

    def inverse(self) -> Pose:
        back = self.rotation.T.copy()
        return Pose._trusted(back, -(back @ self.translation))

    def __matmul__(self, other: Pose) -> Pose:
        # Re-orthonormalised, because a chain of thousands of products drifts.
        return Pose._trusted(
            orthonormal(self.rotation @ other.rotation),
            self.rotation @ other.translation + self.translation,
        )


def along_arc(
    x: float, y: float, heading: float, distance_m: float, turned: float
) -> tuple[float, float]:
    """Return the end of an arc over a plane that begins at ``x``, ``y`` along ``heading``.

    A circle's chord (Siegwart and Nourbakhsh, Introduction to Autonomous Mobile Robots, 5.2.4).

    Args:
        distance_m: along the arc, metres, negative backwards. turned: over it, radians.
    """
    half = turned / 2
    # distance_m * sinc(turned / 2), along the mean heading.
    chord = distance_m * (math.sin(half) / half if abs(half) > 1e-12 else 1.0)
    return x + chord * math.cos(heading + half), y + chord * math.sin(heading + half)


def is_rotation(matrix: ArrayLike, tolerance: float = _ROTATION_TOLERANCE) -> bool:
    """Return whether a (3, 3) matrix is orthonormal with determinant +1, within ``tolerance``."""
    m = np.asarray(matrix, dtype=np.float64)
    if m.shape != (3, 3):
        return False
    # As scalars: for nine numbers numpy's calls cost ten times the arithmetic. Comparisons with
    # NaN or infinity are false.
    (a, b, c), (d, e, f), (g, h, i) = m.tolist()
    return bool(
        abs(a * a + d * d + g * g - 1) <= tolerance
        and abs(b * b + e * e + h * h - 1) <= tolerance
        and abs(c * c + f * f + i * i - 1) <= tolerance
        and abs(a * b + d * e + g * h) <= tolerance
        and abs(a * c + d * f + g * i) <= tolerance
        and abs(b * c + e * f + h * i) <= tolerance
        and a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) > 0
    )


def rotation_matrix(rotvec: Float64Array) -> Float64Array:
    """Return rotations (..., 3, 3) for rotation vectors (..., 3), radians (Rodrigues' formula)."""
    v = np.asarray(rotvec, dtype=np.float64)
    angle2 = (v * v).sum(axis=-1)
    angle = np.sqrt(angle2)
    small = angle < _SMALL_ANGLE
    safe = np.where(small, 1.0, angle)
    sine = np.where(small, 1 - angle2 / 6, np.sin(safe) / safe)
    # 1 - cos as a square, which keeps precision for small angles.
    half = np.where(small, 0.5 - angle2 / 24, 2 * (np.sin(safe / 2) / safe) ** 2)
    cross = cross_matrix(v)
    return np.asarray(
        np.eye(3) + sine[..., None, None] * cross + half[..., None, None] * (cross @ cross)
    )


def orthonormal(rotation: Float64Array) -> Float64Array:
    """Return the rotation (..., 3, 3) nearest to one that rounding has made slightly skew.

    One step of Newton's iteration for the polar decomposition, which converges quadratically
    (Higham: Computing the Polar Decomposition, 1986).
    """
    skew = np.swapaxes(rotation, -1, -2) @ rotation
    return np.asarray(1.5 * rotation - 0.5 * (rotation @ skew), dtype=np.float64)


def _quaternion(rotation: Float64Array) -> tuple[float, float, float, float]:
    """Return the unit quaternion w x y z, w not negative, of a rotation (3, 3).

    Divides by the largest of the four, so that no precision is lost (Shepperd, 1978).
    """
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    squares = (a + e + i, a - e - i, e - a - i, i - a - e)
    largest = squares.index(max(squares))
    if largest == 0:
        q = (1 + squares[0], h - f, c - g, d - b)
    elif largest == 1:
        q = (h - f, 1 + squares[1], b + d, c + g)
    elif largest == 2:
        q = (c - g, b + d, 1 + squares[2], f + h)
    else:
        q = (d - b, c + g, f + h, 1 + squares[3])
    scale = math.copysign(1.0, q[0]) / math.sqrt(sum(x * x for x in q))
    return (q[0] * scale, q[1] * scale, q[2] * scale, q[3] * scale)


def map_pixels(homography: ArrayLike, px: ArrayLike) -> Float64Array:
    """Map pixels (N, 2) by a planar map (3, 3)."""
    H = np.asarray(homography, dtype=np.float64)
    q = np.asarray(px, dtype=np.float64).reshape(-1, 2) @ H[:, :2].T + H[:, 2]
    return np.asarray(q[:, :2] / q[:, 2:], dtype=np.float64)


def largest_sigma(covariance: Float64Array) -> float:
    """Return the largest standard deviation over all directions of a finite covariance (N, N)."""
    # Rounding may leave a largest eigenvalue just below zero.
    return float(np.sqrt(max(0.0, float(np.linalg.eigvalsh(covariance)[-1]))))


def mahalanobis(vector: Float64Array, covariance: Float64Array) -> float:
    """Return the Mahalanobis length of a vector (N,) under a covariance (N, N)."""
    # Rounding may leave the square of a short vector just below zero.
    return float(np.sqrt(max(0.0, float(vector @ np.linalg.solve(covariance, vector)))))


def cross_matrix(vectors: ArrayLike) -> Float64Array:
    """(..., 3, 3) matrices [v]x with [v]x w = v x w."""
    v = np.asarray(vectors, dtype=np.float64)
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out
