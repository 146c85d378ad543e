"""Rigid motions and rotations, in the naming used throughout: ``T_target_source``.

``T_a_b`` maps coordinates given in frame b to coordinates in frame a:
``p_a = T_a_b.apply(p_b)``, so ``T_a_c = T_a_b @ T_b_c``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

Float64Array = NDArray[np.float64]

# A rotation matrix read from text with 7 digits is orthonormal to about 1e-6.
_ROTATION_TOLERANCE = 1e-4


@dataclass(frozen=True, eq=False)
class Pose:
    """A rigid motion ``T_target_source``.

    Attributes:
        rotation: (3, 3) float64, orthonormal, determinant +1.
        translation: (3,) float64, metres: the source frame's origin in the target frame.

    Raises:
        ValueError: the shapes are wrong, a number is not finite or the matrix is no rotation.
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
        if not (np.isfinite(rotation).all() and np.isfinite(translation).all()):
            raise ValueError("a pose must be finite")
        if not is_rotation(rotation):
            raise ValueError("a pose's 3x3 matrix must be a rotation (R^T R = I, det R = +1)")
        rotation.setflags(write=False)
        translation.setflags(write=False)
        object.__setattr__(self, "rotation", rotation)
        object.__setattr__(self, "translation", translation)

    @staticmethod
    def identity() -> Pose:
        return Pose(np.eye(3), np.zeros(3))

    @staticmethod
    def from_matrix(matrix: ArrayLike) -> Pose:
        """From a (3, 4) or (4, 4) homogeneous matrix."""
        m = np.asarray(matrix, dtype=np.float64)
        if m.shape not in ((3, 4), (4, 4)):
            raise ValueError(f"a pose matrix must be (3, 4) or (4, 4), not {m.shape}")
        return Pose(m[:3, :3], m[:3, 3])

    @staticmethod
    def from_rotvec(rotvec: ArrayLike, translation: ArrayLike) -> Pose:
        """From a rotation vector (3,) in radians and a translation (3,) in metres."""
        return Pose(
            Rotation.from_rotvec(np.asarray(rotvec, dtype=np.float64).reshape(3)).as_matrix(),
            np.asarray(translation, dtype=np.float64).reshape(3),
        )

    @staticmethod
    def from_quaternion(wxyz: ArrayLike, translation: ArrayLike) -> Pose:
        """From a quaternion (4,), scalar first, of any length but zero, and metres (3,)."""
        w, x, y, z = np.asarray(wxyz, dtype=np.float64).reshape(4)
        return Pose(Rotation.from_quat([x, y, z, w]).as_matrix(), np.asarray(translation))

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
        x, y, z, w = Rotation.from_matrix(self.rotation).as_quat(canonical=True)
        return np.array([w, x, y, z])

    @property
    def rotvec(self) -> Float64Array:
        """(3,) rotation vector in radians."""
        return np.asarray(Rotation.from_matrix(self.rotation).as_rotvec(), dtype=np.float64)

    def apply(self, points: ArrayLike) -> Float64Array:
        """Map points (..., 3) from the source frame into the target frame."""
        p = np.asarray(points, dtype=np.float64)
        return np.asarray(p @ self.rotation.T + self.translation, dtype=np.float64)

    def rotate(self, vectors: ArrayLike) -> Float64Array:
        """Rotate free vectors (..., 3), such as velocities, into the target frame."""
        v = np.asarray(vectors, dtype=np.float64)
        return np.asarray(v @ self.rotation.T, dtype=np.float64)

    def inverse(self) -> Pose:
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def __matmul__(self, other: Pose) -> Pose:
        # Re-orthonormalised, because a chain of thousands of products drifts.
        u, _, vt = np.linalg.svd(self.rotation @ other.rotation)
        return Pose(u @ vt, self.rotation @ other.translation + self.translation)


def is_rotation(matrix: ArrayLike, tolerance: float = _ROTATION_TOLERANCE) -> bool:
    """Whether a (3, 3) matrix is orthonormal with determinant +1, within ``tolerance``."""
    m = np.asarray(matrix, dtype=np.float64)
    return bool(
        m.shape == (3, 3)
        and np.isfinite(m).all()
        and np.abs(m.T @ m - np.eye(3)).max() <= tolerance
        and np.linalg.det(m) > 0
    )


def map_pixels(homography: ArrayLike, px: ArrayLike) -> Float64Array:
    """Pixels (N, 2) that a planar map (3, 3) makes of pixels (N, 2)."""
    H = np.asarray(homography, dtype=np.float64)
    q = np.asarray(px, dtype=np.float64).reshape(-1, 2) @ H[:, :2].T + H[:, 2]
    return np.asarray(q[:, :2] / q[:, 2:], dtype=np.float64)


def inverse_3x3(matrices: Float64Array) -> Float64Array:
    """Inverses (N, 3, 3) of symmetric positive matrices (N, 3, 3), by cofactors.

    For thousands of small matrices this is several times faster than ``numpy.linalg.inv``. A
    matrix without an inverse gives huge numbers or infinities, never an error.
    """
    m = np.asarray(matrices, dtype=np.float64)
    a, b, c = m[:, 0, 0], m[:, 0, 1], m[:, 0, 2]
    d, e, f = m[:, 1, 1], m[:, 1, 2], m[:, 2, 2]
    out = np.empty_like(m)
    out[:, 0, 0] = d * f - e * e
    out[:, 0, 1] = out[:, 1, 0] = c * e - b * f
    out[:, 0, 2] = out[:, 2, 0] = b * e - c * d
    out[:, 1, 1] = a * f - c * c
    out[:, 1, 2] = out[:, 2, 1] = b * c - a * e
    out[:, 2, 2] = a * d - b * b
    determinant = a * out[:, 0, 0] + b * out[:, 0, 1] + c * out[:, 0, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        out /= determinant[:, None, None]
    return out


def cross_matrix(vectors: ArrayLike) -> Float64Array:
    """(..., 3, 3) matrices [v]x with [v]x w = v x w."""
    v = np.asarray(vectors, dtype=np.float64)
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -v[..., 2], v[..., 1]
    out[..., 1, 0], out[..., 1, 2] = v[..., 2], -v[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -v[..., 1], v[..., 0]
    return out
