"""Bundle adjustment of one camera or a pair from many poses of one flat board.

All parameters are estimated jointly: the lenses, the right camera's pose and every pose of the
board, by least squares of the reprojection errors of the corners (Triggs et al.: Bundle
Adjustment, a Modern Synthesis, 2000). The poses of the board are eliminated first (Schur
complement): steps become cheap, and the inverse of the reduced matrix is the covariance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from observer.calibration.fitting.lens import Lens
from observer.camera import StereoCalibration
from observer.geometry import Float64Array, cross_matrix, orthonormal, rotation_matrix

# Numbers that describe a pose.
POSE = 6
# Levenberg-Marquardt damping: the initial value, and the factors by which it changes.
_FIRST_DAMPING, _LESS, _MORE = 1e-3, 0.2, 8.0
_MOST_DAMPING = 1e8
# A step that gains no more than this share of the sum of squares is the last one.
_CONVERGED = 1e-7
# Of a normal matrix scaled to a unit diagonal: smaller eigenvalues are rounding errors.
_LEAST_EIGENVALUE = 1e-13


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners of the board that one camera saw in all views, ordered by view.

    Attributes:
        view: (N,) number of the view. on_board: (N, 3) metres. px: (N, 2) as seen.
    """

    view: NDArray[np.intp]
    on_board: Float64Array
    px: Float64Array

    def of_views(self, chosen: NDArray[np.bool_]) -> Corners:
        """Return the corners of the chosen views (V,) alone; the views keep their numbers."""
        kept = chosen[self.view]
        return Corners(self.view[kept], self.on_board[kept], self.px[kept])


@dataclass(frozen=True, eq=False)
class StereoModel:
    """Parameters that are estimated.

    Attributes:
        size: width and height of the images, pixels.
        lenses: of the left camera, or of the left and the right one.
        free: (4 + N,) which values of a lens are estimated; the others are fixed.
        R: (3, 3) R_right_left, T: (3,) metres; meaningless for one camera.
        board_R: (V, 3, 3), board_t: (V, 3) metres: T_left_board of each view.
    """

    size: tuple[int, int]
    lenses: tuple[Lens, ...]
    free: NDArray[np.bool_]
    R: Float64Array
    T: Float64Array
    board_R: Float64Array
    board_t: Float64Array

    @property
    def free_count(self) -> int:
        """Number of values of each lens that are estimated."""
        return int(np.count_nonzero(self.free))

    @property
    def global_count(self) -> int:
        """Number of parameters that are estimated besides the poses of the board."""
        return self.free_count * len(self.lenses) + (POSE if len(self.lenses) > 1 else 0)

    @property
    def calibration(self) -> StereoCalibration:
        """The pair as a calibration.

        Raises:
            CalibrationError: it is not a possible calibration.
        """
        left, right = self.lenses
        return StereoCalibration(
            *self.size, left.K, left.D, right.K, right.D, self.R, self.T, left.model
        )

    def changed(self, change: Float64Array) -> StereoModel:
        """Return the model, its global parameters changed by (G,) as of ``Adjusted.covariance``."""
        each = self.free_count
        lenses = []
        for index, lens in enumerate(self.lenses):
            values = lens.values.copy()
            values[self.free] += change[index * each : (index + 1) * each]
            lenses.append(replace(lens, values=values))
        if len(lenses) == 1:
            return replace(self, lenses=tuple(lenses))
        turn, shift = change[2 * each : 2 * each + 3], change[2 * each + 3 :]
        R = rotation_matrix(turn) @ self.R
        return replace(self, lenses=tuple(lenses), R=R, T=self.T + shift)


# Derivatives (N, 2, F) of one camera's pixels by parameters that an adjustment does not estimate.
# Arguments: the model, the camera's number, its corners and their derivatives by pose (N, 2, 6).
FurtherDerivatives: TypeAlias = Callable[[StereoModel, int, Corners, Float64Array], Float64Array]


@dataclass(frozen=True, eq=False)
class Adjusted:
    """The best model, and how it fits.

    Attributes:
        residuals: of each camera (N, 2) px, seen minus expected, in the order of its corners.
        covariance: (G, G) of the free values of each lens in turn, then of the rotation by which
            R is multiplied from the left (rad) and of T (m); scaled by the residuals. None where
            the views leave a parameter undetermined.
        scatter_px: standard deviation of a residual's component, by the degrees of freedom.
    """

    model: StereoModel
    residuals: tuple[Float64Array, ...]
    covariance: Float64Array | None
    scatter_px: float


def adjust(
    model: StereoModel,
    corners: Sequence[Corners],
    *,
    soft_px: float = np.inf,
    iterations: int = 60,
    hold: bool = False,
) -> Adjusted:
    """Return the model near ``model`` that fits the corners best.

    Args:
        corners: of each camera of the model.
        soft_px: residuals longer than this count in proportion to their length, not to its
            square (Huber), which keeps single wrong corners from dominating.
        iterations: maximum number of steps.
        hold: estimate only the poses of the board, with lenses and cameras fixed.
    """
    linear = _linear(model, corners, soft_px, hold)
    damping = _FIRST_DAMPING
    for _ in range(iterations):
        if linear is None:
            break
        while damping < _MOST_DAMPING:
            step = linear.step(damping)
            trial = model if step is None else _moved(model, *step)
            after = _linear(trial, corners, soft_px, hold)
            if after is not None and after.cost < linear.cost:
                break
            damping *= _MORE
        else:
            break
        gain = (linear.cost - after.cost) / max(linear.cost, 1e-300)
        model, linear, damping = trial, after, max(damping * _LESS, 1e-12)
        if gain < _CONVERGED:
            break
    residuals = tuple(derivatives(model, index, each)[0] for index, each in enumerate(corners))
    used = len({int(v) for each in corners for v in np.unique(each.view)})
    freedom = sum(2 * len(each.px) for each in corners) - POSE * used
    freedom -= 0 if hold else model.global_count
    if linear is None or hold:
        return Adjusted(model, residuals, None, np.nan)
    scatter = float(np.sqrt(linear.squares / max(freedom, 1)))
    return Adjusted(model, residuals, linear.covariance(scatter), scatter)


@dataclass(frozen=True, eq=False)
class _Linear:
    """The normal equations linearized at one model, one block for each pose of the board."""

    cost: float
    squares: float
    H: Float64Array  # (V, G, G)
    g: Float64Array  # (V, G)
    A: Float64Array  # (V, 6, 6)
    B: Float64Array  # (V, G, 6)
    a: Float64Array  # (V, 6)

    def step(self, damping: float) -> tuple[Float64Array, Float64Array] | None:
        """Changes (G,) and (V, 6) of the parameters; None where there is no solution."""
        A = self.A + damping * self.A * np.eye(POSE) + 1e-12 * np.eye(POSE)
        H = self.H.sum(axis=0)
        H += damping * np.diag(np.diag(H))
        try:
            inverse = np.linalg.inv(A)
            gain = self.B @ inverse
            S = H - np.einsum("vgi,vhi->gh", gain, self.B)
            v = self.g.sum(axis=0) - np.einsum("vgi,vi->g", gain, self.a)
            scale = 1 / np.sqrt(np.maximum(np.diag(S), 1e-300))
            lens = scale * np.linalg.solve(S * np.outer(scale, scale), scale * v)
        except np.linalg.LinAlgError:
            return None
        pose = np.einsum("vij,vj->vi", inverse, self.a - np.einsum("vgi,g->vi", self.B, lens))
        if not (np.isfinite(lens).all() and np.isfinite(pose).all()):
            return None
        return lens, pose

    def reduced(self) -> tuple[Float64Array, Float64Array]:
        """Normal matrices (V, G, G) and right-hand sides (V, G) of each view, its pose eliminated.

        Raises:
            numpy.linalg.LinAlgError: a view does not determine its pose.
        """
        gain = self.B @ np.linalg.inv(self.A + 1e-12 * np.eye(POSE))
        S = self.H - np.einsum("vgi,vhi->vgh", gain, self.B)
        return S, self.g - np.einsum("vgi,vi->vg", gain, self.a)

    def covariance(self, scatter: float) -> Float64Array | None:
        try:
            S = self.reduced()[0].sum(axis=0)
        except np.linalg.LinAlgError:
            return None
        diagonal = np.diag(S)
        if not (np.isfinite(S).all() and (diagonal > 0).all()):
            return None
        scale = 1 / np.sqrt(diagonal)
        values, vectors = np.linalg.eigh(S * np.outer(scale, scale))
        if values[0] <= _LEAST_EIGENVALUE:
            return None
        inverse = (vectors / values) @ vectors.T
        return np.asarray(scatter**2 * inverse * np.outer(scale, scale), dtype=np.float64)


def reduced_by_view(
    model: StereoModel,
    corners: Sequence[Corners],
    soft_px: float,
    further: FurtherDerivatives | None = None,
) -> tuple[Float64Array, Float64Array]:
    """Normal equations of the global parameters for each view with corners, its pose eliminated.

    Args:
        further: for parameters that the fit does not estimate; they follow those that it does.

    Returns:
        (V, G, G) matrices and (V, G) right-hand sides, px^2 over the parameters' units; summed
        over the views they are those of the whole fit. At its solution the right-hand sides
        cancel.
    """
    linear = _linear(model, corners, soft_px, False, further)
    assert linear is not None, "a model that was fitted sees its corners"
    S, s = linear.reduced()
    seen = np.unique(np.concatenate([each.view for each in corners]))
    return S[seen], s[seen]


def derivatives(
    model: StereoModel, camera: int, corners: Corners
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Residuals (N, 2) px, seen minus expected, and the derivatives of the expected pixels.

    Returns:
        The residuals, NaN for corners not in front of the lens; the derivatives (N, 2, 6) by a
        rotation (rad) and a translation (m) of the board in the corner's own view, in the left
        camera's frame; and those (N, 2, G) by the global parameters, in the order of
        ``Adjusted``.
    """
    turned = np.einsum("nij,nj->ni", model.board_R[corners.view], corners.on_board)
    place = turned + model.board_t[corners.view]
    swung = place @ model.R.T
    at = place if camera == 0 else swung + model.T
    px, by_point, by_lens = model.lenses[camera].project(at)
    # In the left camera's frame a rotation by w moves a point of the board by w x p = -[p]x w.
    to_left = by_point if camera == 0 else by_point @ model.R
    by_pose = np.concatenate([-to_left @ cross_matrix(turned), to_left], axis=2)
    each = model.free_count
    by_global = np.zeros((len(px), 2, model.global_count))
    by_global[:, :, camera * each : (camera + 1) * each] = by_lens[:, :, model.free]
    if camera == 1:
        by_global[:, :, 2 * each : 2 * each + 3] = -by_point @ cross_matrix(swung)
        by_global[:, :, 2 * each + 3 :] = by_point
    return corners.px - px, by_pose, by_global


def _linear(
    model: StereoModel,
    corners: Sequence[Corners],
    soft_px: float,
    hold: bool,
    further: FurtherDerivatives | None = None,
) -> _Linear | None:
    every = [derivatives(model, camera, seen) for camera, seen in enumerate(corners)]
    if not all(np.isfinite(residual).all() for residual, _, _ in every):
        return None
    if further is not None:
        every = [
            (residual, P, np.concatenate([G, further(model, camera, seen, P)], axis=2))
            for camera, (seen, (residual, P, G)) in enumerate(zip(corners, every, strict=True))
        ]
    views, count = len(model.board_R), every[0][2].shape[2]
    H, g = np.zeros((views, count, count)), np.zeros((views, count))
    A, B = np.zeros((views, POSE, POSE)), np.zeros((views, count, POSE))
    a = np.zeros((views, POSE))
    cost = squares = 0.0
    for seen, (residual, P, G) in zip(corners, every, strict=True):
        weight, part = _weighed(residual, soft_px)
        cost += part
        squares += float((weight[:, None] * residual**2).sum())
        root = np.sqrt(weight)[:, None, None]
        P *= root
        G *= 0 if hold else root
        r = residual * root[:, :, 0]
        begin = np.searchsorted(seen.view, np.arange(views + 1))
        for view in np.unique(seen.view):
            rows = slice(begin[view], begin[view + 1])
            Pv, Gv = P[rows].reshape(-1, POSE), G[rows].reshape(-1, count)
            H[view] += Gv.T @ Gv
            g[view] += Gv.T @ r[rows].reshape(-1)
            A[view] += Pv.T @ Pv
            B[view] += Gv.T @ Pv
            a[view] += Pv.T @ r[rows].reshape(-1)
    if hold:
        H[:] = np.eye(count)
    return _Linear(cost, squares, H, g, A, B, a)


def _weighed(residual: Float64Array, soft_px: float) -> tuple[Float64Array, float]:
    """Huber weights (N,) and cost of residuals (N, 2)."""
    length = np.linalg.norm(residual, axis=1)
    weight = np.minimum(1.0, soft_px / np.maximum(length, 1e-12))
    far = length > soft_px
    cost = np.where(far, soft_px * (2 * length - soft_px) if np.isfinite(soft_px) else 0, length**2)
    return weight, float(cost.sum())


def _moved(model: StereoModel, lens: Float64Array, pose: Float64Array) -> StereoModel:
    changed = model.changed(lens)
    return replace(
        changed,
        R=orthonormal(changed.R) if len(model.lenses) > 1 else model.R,
        board_R=orthonormal(rotation_matrix(pose[:, :3]) @ model.board_R),
        board_t=model.board_t + pose[:, 3:],
    )
